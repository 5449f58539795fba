"""The process that writes the logs of a node."""
