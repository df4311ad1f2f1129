"""Answers of the autopilot to commands: which one is meant, and whether it is a refusal."""

from __future__ import annotations

from companion.errors import TransferError
from companion.link.wire.decoded_frame import CommandAck
from companion.types.mavlink_enums import CommandResult, name_of


def is_result_of(reply: object, command: int) -> bool:
    """Return whether a message is the final result of a command.

    Parameters
    ----------
    reply : object
        A decoded message of the autopilot.
    command : int
        Number of the command, as in MAV_CMD.
    """
    if not isinstance(reply, CommandAck) or reply.command != command:
        return False
    return reply.result != CommandResult.IN_PROGRESS


def require_success(operation: str, answer: object | None) -> None:
    """Check that a command was carried out.

    Parameters
    ----------
    operation : str
        Name of the command, for the error.
    answer : object or None
        The autopilot's answer; None if there was none.

    Raises
    ------
    TransferError
        If there is no answer, or if it is a refusal.
    """
    if answer is None:
        raise TransferError(operation, "no answer")
    if isinstance(answer, CommandAck) and answer.result != CommandResult.ACCEPTED:
        raise TransferError(operation, name_of(CommandResult, answer.result))
