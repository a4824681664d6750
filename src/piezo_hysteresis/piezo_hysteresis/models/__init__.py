"""Named chains of blocks: classical, modified, extended, enhanced, second order, ..."""
