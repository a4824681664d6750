"""Records as discovery sees them: checked, annotated, split, their tones on one clock."""
