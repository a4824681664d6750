"""Piezo controllers, with an actuator of `piezo_sim` behind them: GCS 2, and the NV200."""
