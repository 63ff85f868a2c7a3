"""Whether requirements say what was meant: bounded model checking of their programs."""
