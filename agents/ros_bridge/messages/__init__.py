"""ROS 2 messages: their definitions, names, hashes, and their encoding as CDR."""
