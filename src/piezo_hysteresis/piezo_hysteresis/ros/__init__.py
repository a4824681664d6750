"""What nodes share: declaring parameters, processes, spinning, quality of service."""
