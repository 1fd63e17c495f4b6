"""Transports messages: links, keys, finding one another, and large messages in shared memory."""
