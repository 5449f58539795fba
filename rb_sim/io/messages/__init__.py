"""ROS 2 messages of a sample: topics, types, bytes."""
