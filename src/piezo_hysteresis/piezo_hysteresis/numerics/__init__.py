"""What several rooms compute; knows nothing of actuators."""
