"""The grammar of the specification language and the parser that ANTLR makes of it."""
