"""Feedback as a link of the chain: PID, fuzzy PID (Fang 2019) or H-infinity (Xiao 2014)."""

from __future__ import annotations

import sys

from piezo_hysteresis.nodes.links.tracking_node import TrackingNode
from piezo_hysteresis.parameters.links import FEEDBACK
from piezo_hysteresis.ros.running import run_node
from piezo_hysteresis.runtime.laws import FeedbackLaws


def feedback(*, wired: bool = True) -> TrackingNode:
    """Return an optional link, which adds the output of a control law on the tracking error."""
    return TrackingNode('feedback', FEEDBACK, FeedbackLaws(), wired=wired)


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(feedback))
