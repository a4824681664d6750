"""The figures and tables of five papers, reproduced on the simulated actuators."""
