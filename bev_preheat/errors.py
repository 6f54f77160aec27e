# SPDX-License-Identifier: Apache-2.0
"""The exceptions that the package raises on purpose."""


class InvalidInput(ValueError):
    """Input that was refused at the door; the message names field, value and what is allowed."""

    def __init__(self, problems):
        """`problems`: one sentence, or a sequence of them."""
        self.problems = [problems] if isinstance(problems, str) else list(problems)
        super().__init__('; '.join(self.problems))


class PlanningFailure(ArithmeticError):
    """The model left the range of numbers: no plan can be made from this input."""
