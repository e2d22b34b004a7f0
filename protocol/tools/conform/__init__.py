"""Does a controller keep the rules of docs/bring-your-own-robot.md? Tried over its own link.

`examine` tries all rules, or some, and yields a `Result` for each.
"""

from robotree.protocol.tools.conform.examine import NotHeard, Outcome, Result, examine
from robotree.protocol.tools.conform.motions import KINDS
from robotree.protocol.tools.conform.rules import RULES, Level, Rule

__all__ = ["KINDS", "RULES", "Level", "NotHeard", "Outcome", "Result", "Rule", "examine"]
