"""Questions and answers between agents, over any transport: asking, serving, and whose a name is."""
