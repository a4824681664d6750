"""What the packages of the suite share without ROS: parameter tables, order, time, health."""
