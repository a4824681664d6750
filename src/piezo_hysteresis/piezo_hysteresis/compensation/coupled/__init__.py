"""Laws of several coupled axes: one step takes the references of all and returns all voltages."""
