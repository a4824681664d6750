"""What the number of a sample says about the one who counts them; knows no ROS."""

# Messages of one writer come in order; further back than this it was started anew.
REORDERED = 64


def started_anew(sample: int, newest: int) -> bool:
    """Tell whether a source that was at `newest` has been restarted, now that `sample` comes."""
    return sample < newest and (sample == 0 or newest - sample > REORDERED)
