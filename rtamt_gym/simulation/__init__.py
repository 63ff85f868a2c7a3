"""One simulation of any kind under specifications: what runs, the record, its picture and file."""
