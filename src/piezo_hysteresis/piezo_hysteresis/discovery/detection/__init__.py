"""Detection limits: how small an effect the records would have shown, and what it looks like."""
