"""The questions that a script has put to people, until each is answered. Pure; asked of from any thread."""

from __future__ import annotations

from collections.abc import Mapping

from robotree.vr.scripts.happening import PersonAsked

MOST_QUESTIONS = 20
"""Questions of one script that wait."""
SEPARATOR = " | "
"""Between the answers as an attribute says them."""
ANSWER_LENGTH = 400
"""Letters of an answer."""


class Questions:
    """Open questions by conversation, the oldest first."""

    def __init__(self) -> None:
        """Nothing is asked."""
        self._open: dict[str, PersonAsked] = {}
        """Another one after each change, so that who looks at it has the one or the other."""

    def __len__(self) -> int:
        return len(self._open)

    def ask(self, question: PersonAsked) -> None:
        """Put a question; one of the same conversation is replaced, and comes last."""
        self.take_back(question.conversation)
        self._open = {**self._open, question.conversation: question}

    def take_back(self, conversation: str) -> None:
        """Take a question back, if it waits."""
        self._open = {key: one for key, one in self._open.items() if key != conversation}

    def attributes(self) -> Mapping[str, str]:
        """Return the oldest question as attributes of its robot; empty: there is none."""
        first = next(iter(self._open.values()), None)
        if first is None:
            return {}
        more = {"asked": f"and {len(self._open) - 1} more"} if len(self._open) > 1 else {}
        answers = {"answers": SEPARATOR.join(first.answers)} if first.answers else {}
        return {"question": first.question, "question-id": first.conversation, **answers, **more}

    def meant(self, conversation: str) -> PersonAsked | None:
        """Return the question of a conversation, or the oldest one (empty); None: there is none."""
        if conversation:
            return self._open.get(conversation)
        return next(iter(self._open.values()), None)


def wrong(question: PersonAsked, answer: str) -> str:
    """Return why an answer is none, as a clause; empty: it is."""
    if question.answers and answer not in question.answers:
        return f"{answer!r} is no answer to that; there are: {', '.join(question.answers)}"
    if not answer.strip() or len(answer) > ANSWER_LENGTH:
        return f"an answer has 1 to {ANSWER_LENGTH} letters"
    return ""
