"""A piezo controller that speaks GCS 2, with an actuator of `piezo_sim` behind it."""
