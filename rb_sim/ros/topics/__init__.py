"""What the node publishes and subscribes to."""
