"""How a chain is simulated: exactly between the ticks, and with its derivatives."""
