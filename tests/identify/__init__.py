"""From logs to vehicles."""
