"""Scripts: rules that lead robots. See docs/scripts.md."""
