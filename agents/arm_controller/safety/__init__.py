"""What keeps an arm from harm: the emergency stop, and a watchdog of all that a motion relies on."""
