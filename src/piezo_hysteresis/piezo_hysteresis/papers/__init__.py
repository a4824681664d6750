"""The figures and tables of five papers, made again on the simulated actuators."""
