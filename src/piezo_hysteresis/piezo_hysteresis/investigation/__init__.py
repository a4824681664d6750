"""Active discovery: response prediction, choice of the next experiment, and journal."""

# Files of an investigation in its folder; this module is imported without the rest of the room.
BASELINE, JOURNAL, BAGS = 'baseline.yaml', 'journal.jsonl', 'bags'
FOUND, SUMMARY, AFTERWARDS = 'found', 'investigation.json', 'afterwards'
