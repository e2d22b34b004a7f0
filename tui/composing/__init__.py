"""A virtual robot without writing code: steps that a person chooses or shows, and the page made of them.

steps          what a composition is, and whether it can be meant
lines          the same as text, which people read and edit
demonstration  what was shown once, as steps with names and parameters
page           the page, its panel and its test, as text
play           what a composition commands, without any robot
writing        the files, checked before they are written
"""
