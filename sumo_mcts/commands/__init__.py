"""What the commands do, as plain functions: a file for each, no printing, no exit status."""
