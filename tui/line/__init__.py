"""One line, at the prompt, in a shell or in a script: the registry of verbs, how they read, what they do."""
