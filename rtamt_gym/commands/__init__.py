"""The commands of `rtamt`, one file each: its arguments, and what it prints."""
