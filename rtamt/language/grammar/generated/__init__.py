"""Made by ANTLR from Stl.g4 (see generate.py). Never edited."""
