# The machines in C++; the definition they are tested against is rtamt.discrete.
