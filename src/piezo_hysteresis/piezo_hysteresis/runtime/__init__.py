"""What the nodes do that needs no ROS: plans, order of samples, fades, watchdogs, health."""
