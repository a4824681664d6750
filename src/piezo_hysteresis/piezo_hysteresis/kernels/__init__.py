"""How kernels are compiled, where their machine code is kept, and who is notified."""
