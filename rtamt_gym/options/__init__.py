"""Every option once: its default, its choices and the sentence that describes it."""
