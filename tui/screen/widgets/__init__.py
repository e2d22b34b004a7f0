"""The parts of the full screen. They draw the store and ask for verbs; they know no agent."""
