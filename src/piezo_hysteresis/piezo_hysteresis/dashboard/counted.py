"""Descriptions of the counters of nodes, for the page and its documentation."""

from __future__ import annotations

COUNTED = {
    'late': 'input or ticks that came after their time',
    'missed': 'ticks that never came',
    'refused': 'values that are no number, beyond the range or far ahead',
    'limited': 'ticks at which a limit changed the voltage',
    'doubled': 'messages that came twice, as when a sender repeats its last one; harmless',
    'reordered': 'messages that came behind later ones',
    'strays': 'messages numbered far from the rest',
    'stale': 'times that the input stayed away and the voltage was ramped to safety',
    'stamp_jumps': 'time stamps off the clock of the samples; only their numbers count',
    'out_of_range': 'ticks at which the voltage was cut at limits.low or limits.high',
    'slew_limited': 'ticks at which the voltage was slowed down to the slew limit',
    'energy_limited': 'ticks at which the voltage was slowed down to keep energy_limit',
    'out_of_stroke': 'ticks at which the reference lay beyond the stroke of the model',
    'clamped_slopes': 'ticks at which the slope of the inverse was clamped',
    'dropped': 'ticks left out because their reference never came',
    'windows': 'windows of whole periods that attenuation has evaluated',
    'restarts': 'times that a law, or the counting of ticks, began again',
    'bounded': 'corrections that were held at their bound',
    'frozen': 'readings of the sensor that repeat the one before',
    'law_reset': 'times that a law returned NaN and was reset',
    'overruns': 'ticks of the simulator that began late',
}
