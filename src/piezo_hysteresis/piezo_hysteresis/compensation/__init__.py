"""Inverses, harmonic attenuation, feedback laws and limits; knows no ROS."""
