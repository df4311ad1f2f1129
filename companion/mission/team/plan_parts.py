"""Joins the fragments of plans, which arrive in any order and more than once."""

from __future__ import annotations

from companion.mission.team.wire import Fragment


class PlanParts:
    """The fragments of plans that have not arrived as a whole."""

    def __init__(self) -> None:
        self._parts: dict[int, dict[int, dict[int, bytes]]] = {}  # Parts by sender and plan number.

    def joined(self, sender: int, part: Fragment) -> bytes | None:
        """Take in a fragment; returns the data of the whole plan when nothing of it is missing.

        What was kept of plans that are neither the sender's committed nor its latest one is dropped, so that
        no more than two plans a member are kept.

        Parameters
        ----------
        sender : int
            System id of the sender.
        part : Fragment
            The fragment.
        """
        current = (part.standing.committed, part.standing.latest)
        kept = {number: parts for number, parts in self._parts.get(sender, {}).items() if number in current}
        parts = kept.pop(part.number, {}) | {part.index: part.data}
        if len(parts) < part.count:
            kept[part.number] = parts
        self._parts[sender] = kept
        if len(parts) < part.count:
            return None
        return b"".join(data for _, data in sorted(parts.items()))
