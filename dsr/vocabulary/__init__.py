"""Words that agents share: relations, goals, intentions, actions, requests, and how nodes say them."""
