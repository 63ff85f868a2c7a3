"""The grammar of the specification language, and text to specifications by it; see parser.py."""
