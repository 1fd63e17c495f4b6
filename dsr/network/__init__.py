"""What carries messages: transports, keys, finding one another, and large messages in shared memory."""
