"""ROS 2 bags (MCAP): written, read, mended."""
