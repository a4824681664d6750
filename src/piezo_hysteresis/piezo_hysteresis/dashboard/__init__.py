"""The live page: what it knows, how it is decimated, drawn and served; knows no ROS."""
