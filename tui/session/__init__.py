"""Session scripts: the verbs, one a line, with what is expected of them."""
