"""The sections of a scenario file: every key with its unit, its default and its bounds."""
