"""Many episodes: what they say together."""
