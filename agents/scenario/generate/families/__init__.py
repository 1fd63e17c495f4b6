"""The families of random episodes, by what happens in them."""
