"""The live page: state, decimation, drawing and server; independent of ROS."""
