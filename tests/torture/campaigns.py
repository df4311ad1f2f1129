"""Campaigns of whole flights: over a lossy link, with the service killed, with a pilot who takes over."""

import asyncio
from collections import Counter
from dataclasses import replace

import numpy as np

from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from sim.faults import FaultKind, LinkFaults, Schedule, random_schedule
from tests.torture.harness import KINDS, TortureHarness, flown

TO_THE_GOAL_S = 130.0
OVER_LOSSES_S = 300.0
LOSS = 0.2
PILOT_MODES = {
    Dialect.ARDUPILOT: ("FBWA", "LOITER", "RTL", "MANUAL", "CRUISE"),
    Dialect.PX4: ("STABILIZED", "LOITER", "RTL", "ALTCTL", "POSCTL"),
}


def lossy_schedule(dialect, seed):
    """A fifth of all frames lost all along, with the spells and events of a random schedule on top."""
    kinds = tuple(kind for kind in KINDS[dialect] if kind is not FaultKind.REBOOT)
    made = random_schedule(seed, OVER_LOSSES_S, kinds)
    spells, now = [], 0.0
    for begin, end, faults in made.spells:
        spells.append((now, begin, LinkFaults(loss=LOSS)))
        # A link that refuses everything or is seconds late for a minute is the torture's business.
        spells.append((begin, min(end, begin + 10.0), worse(faults)))
        now = min(end, begin + 10.0)
    spells.append((now, 2.0 * OVER_LOSSES_S, LinkFaults(loss=LOSS)))
    return Schedule(tuple(spells), made.events)


def worse(faults):
    return replace(faults, loss=max(faults.loss, LOSS))


def outcome(harness, verdict):
    """How a flight ended: at the goal, in an announced step of the emergency strategy, or otherwise."""
    if verdict.collision:
        return "collision"
    if verdict.violations:
        return "violation"
    if harness.app.mode is Mode.ARRIVED:
        return "goal"
    if harness.app.emergency is not None:
        return f"emergency: {harness.app.emergency.value}"
    return f"flying ({harness.app.mode.name})"


def lossy_flight(dialect, seed):
    """One flight over a link that loses a fifth."""
    harness = TortureHarness(dialect, seed, lossy_schedule(dialect, seed))
    verdict = asyncio.run(flown(harness, OVER_LOSSES_S))
    return outcome(harness, verdict), harness


def killed_flight(dialect, seed, folder):
    """One flight in which the service is killed once; when it plans again [s] after that."""
    random = np.random.default_rng(seed)
    at_s = float(random.uniform(2.0, 60.0))
    harness = TortureHarness(dialect, seed, Schedule(), folder)
    seen = {}
    act = harness.act

    def watched(inner):
        act(inner)
        if harness.now_s >= at_s and "killed" not in seen:
            seen["killed"] = harness.now_s
            harness.is_killed = True
        elif "killed" in seen and "planned" not in seen and len(harness.apps) == 2:
            # On the last leg there is nothing left to plan: then it knows that instead.
            knows = harness.app.num_plans > 0 or harness.app.state.flown is not None
            if knows:
                seen["planned"] = harness.now_s

    harness.act = watched
    verdict = asyncio.run(flown(harness, TO_THE_GOAL_S))
    return outcome(harness, verdict), seen.get("planned", np.inf) - seen.get("killed", at_s)


def piloted_flight(dialect, seed):
    """One flight in which the pilot takes over for good; what was sent afterwards that changes anything."""
    random = np.random.default_rng(seed)
    at_s, modes = float(random.uniform(1.0, 45.0)), PILOT_MODES[dialect]
    mode = modes[int(random.integers(len(modes)))]
    harness = TortureHarness(dialect, seed, Schedule())
    harness.judge.look = lambda now_s, verdict: None  # the pilot flies, not the mission
    switched = []

    def act(_deck):
        if harness.now_s >= at_s and not switched:
            switched.append(harness.now_s)
            harness.simulator.set_mode(mode)

    harness.act = act
    asyncio.run(flown(harness, at_s + 20.0))
    # The heartbeat that tells it goes out in the step of the switch.
    return harness.changes(after_s=switched[0] + 0.021), harness.simulator.autopilot.mode == mode


def run_losses(number, first_seed, say):
    """Flights over a lossy link, half of them an autopilot."""
    bad = 0
    for dialect in Dialect:
        counts, swaps = Counter(), 0
        for seed in range(first_seed, first_seed + number // 2):
            how, harness = lossy_flight(dialect, seed)
            counts[how] += 1
            swaps += harness.app.num_swaps
            if how != "goal" and not how.startswith("emergency"):
                bad += 1
                say(f"  {dialect.value} seed {seed}: {how} {harness.verdict.violations[:2]}")
        say(f"{dialect.value}, 20 % loss and random faults: {dict(counts)}, {swaps} swaps")
    return bad


def run_kills(number, first_seed, say, folder):
    """Kills at random moments, half of them an autopilot."""
    bad = 0
    for dialect in Dialect:
        counts, waits = Counter(), []
        for seed in range(first_seed, first_seed + number // 2):
            how, wait_s = killed_flight(dialect, seed, folder / f"{dialect.value}-{seed}")
            counts[how] += 1
            waits.append(wait_s)
            if wait_s >= 5.0 or how in ("collision", "violation"):
                bad += 1
                say(f"  {dialect.value} seed {seed}: {how}, {wait_s:.1f} s")
        say(f"{dialect.value}, killed: {dict(counts)}, planning again after {max(waits):.1f} s at most")
    return bad


def run_pilots(number, first_seed, say):
    """Pilots who take over at random moments, half of them an autopilot."""
    bad = 0
    for dialect in Dialect:
        fights = 0
        for seed in range(first_seed, first_seed + number // 2):
            sent, is_kept = piloted_flight(dialect, seed)
            if sent or not is_kept:
                fights += 1
                say(f"  {dialect.value} seed {seed}: {sent[:3]}, mode kept: {is_kept}")
        say(f"{dialect.value}, pilot takes over: {number // 2} flights, {fights} fights")
        bad += fights
    return bad
