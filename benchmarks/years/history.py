"""One history of the whole memory: its processes, network, disks and clocks, and the steps that happen to them.

All that threads do in a real process is a task here: to send, to merge, to keep the state. In which order tasks run,
and which are left out for a while, follows from the seed.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable

import numpy as np

from benchmarks.years.disk import FailingDisk
from benchmarks.years.lifeline import KilledError, Lifeline
from benchmarks.years.meshes import MeshesInSeveral, lie
from benchmarks.years.rogue import POLICY, Rogue
from benchmarks.years.steps import NAMES, WORLDS, Step
from benchmarks.years.world import CATCH_UP, FORGER, Participant, SkewedClock, World
from benchmarks.years.worlds import HERE, WorldsInSeveral, mark
from dsr import ClockDriftError, ConfigError, Faults, Memory
from dsr.crdt.context import CausalContext, DotRange
from dsr.network.keys import Keys
from dsr.persistence.world_keeper import WorldKeeper
from dsr.security.gate import Gate

TICK = 0.1
"""s of one step of time while nothing else happens"""
LONG_TICK = 0.5
"""s of one step while nothing is under way: of what is due then nothing comes more often than twice a second"""
MOST_FILES = 6
"""Files of a state folder: two snapshots, the journals since the first of them, and the lock."""


class History(World):
    """Processes with disks, worlds and meshes, some of which may be killed, stopped or cut off; see `begun`.

    Args:
        places: processes.
        seed: of all that is random.
        disks: those of the first places, which keep the state there.
        secured: whether the graph is secured, with an agent among them that exceeds its rights.
    """

    def __init__(self, places: int, seed: int, disks: list[FailingDisk], *, secured: bool = False) -> None:
        self.secured = secured
        self.kills: Counter[str] = Counter()
        """At which kinds of calls processes were killed."""
        self._met: Counter[str] = Counter()
        self.lived = self.slept = 0.0
        """s that passed with all doing what is due, and with all asleep."""
        self.disks = disks
        self.keepers: dict[int, WorldKeeper] = {}
        self.places = places
        self._random = np.random.default_rng(seed)
        self._lives: dict[int, Lifeline] = {}
        self._down: dict[int, float] = {}
        self._stopped: set[int] = set()
        self._flushed: dict[int, list[DotRange]] = {}
        super().__init__([0.0] * places, seed)
        self.worlds = WorldsInSeveral(lambda: [participant.memory for participant in self.participants])
        self.meshes = MeshesInSeveral(lambda: [participant.memory for participant in self.participants])
        self.rogue = Rogue(self) if secured else None
        if not secured:
            self.forger.serve(Keys("g").mesh(f"{FORGER}-1"), lie)
        for participant in self.participants[: len(self.disks)]:
            self._keep(participant)
        for _ in range(20):
            self.advance(TICK)

    @property
    def met(self) -> Counter[str]:
        """All faults so far, by kind."""
        deaths = Counter({"kill": sum(self.kills.values())})
        return sum((disk.met for disk in self.disks), self._met + self.network.met + deaths)

    # ---- processes

    def _connected(self, index: int, clock: SkewedClock) -> Memory:
        life = self._lives.setdefault(index, Lifeline(self.kills))
        transport = life.watch(self.network.connect(str(index)))
        gate = Gate(POLICY) if self.secured else None
        rid = f"r{index}-{self._boots}"
        return Memory("g", f"r{index}", transport=transport, clock=clock, rid=rid, gate=gate)

    def _keep(self, participant: Participant) -> None:
        """Restore the state from the disk of a process, and keep it there."""
        place, disk = participant.place, self.disks[participant.place]
        disk.life = self._lives[place]
        try:
            kept = WorldKeeper(participant.memory, disk.root, threaded=False)
        except ConfigError as error:
            assert disk.full or disk.errors, f"what is on the disk cannot be used: {error}"
            self._bury(participant)
            return
        self.keepers[place] = kept
        context = participant.memory.replica.graph.store.context
        flushed = self._flushed.get(place, [])
        assert context.covers(CausalContext(flushed)), "what was flushed to the disk is lost"

    def _start(self, place: int, calls: int | None = None) -> None:
        """Start the process of a place, which may be killed at one of its first calls."""
        self._lives[place] = life = Lifeline(self.kills)
        if calls is not None:
            life.arm(calls)
        skew = self._down.pop(place)
        try:
            participant = self._boot(place, skew)
        except KilledError:
            self._leave_network(str(place))
            self._down[place] = skew
            return
        self.participants = sorted([*self.participants, participant], key=lambda each: each.place)
        if place < len(self.disks):
            self._do(participant, lambda: self._keep(participant))

    def _leave_network(self, name: str) -> None:
        for transport in list(self.network._transports):
            if transport.name == name:
                transport.close()

    def _bury(self, participant: Participant) -> None:
        """A process is dead: nobody says goodbye."""
        place = participant.place
        self.dead.add(participant.memory.rid)
        participant.memory.transport.close()
        self.network.resume(str(place))
        self.participants = [other for other in self.participants if other is not participant]
        self.keepers.pop(place, None)
        self._stopped.discard(place)
        self._down[place] = participant.clock.skew
        if place < len(self.disks):
            self.disks[place].let_go()

    def _do(self, participant: Participant, task: Callable[[], object]) -> None:
        """Let a process do something, which it may not survive."""
        try:
            task()
        except KilledError:
            if participant in self.participants:
                self._bury(participant)

    @property
    def running(self) -> list[Participant]:
        """The processes that are neither dead nor stopped."""
        return [participant for participant in self.participants if participant.place not in self._stopped]

    def memory(self, index: int) -> Memory:
        """The memory of one of those that run."""
        running = self.running
        return running[index % len(running)].memory

    def deliver(self) -> None:
        """Everybody sends, merges and keeps, in a random order; some tasks get no turn this time."""
        running = self.running
        tasks: list[tuple[Participant | None, Callable[[], object]]] = []
        for participant in running:
            tasks += [(participant, participant.memory.flush), (participant, participant.memory.poll)]
            if participant.place in self.keepers and self._random.random() < 0.3:
                tasks.append((participant, lambda place=participant.place: self._flush(place)))  # type: ignore[misc]
        tasks += [(None, self.network.deliver)] * 2
        self._random.shuffle(tasks)
        for who, task in tasks[: -1 if self._random.random() < 0.2 else None]:
            if who is None:
                task()
            elif who in self.participants:
                self._do(who, task)
        self.network.deliver()

    def _flush(self, place: int) -> None:
        """Have the state on the disk, and note what is there then."""
        kept = self.keepers[place]
        kept.flush()
        if kept.base._retry_at is None:
            graph = kept.base._graph
            self._flushed[place] = list(graph.store.context.ranges())

    @property
    def is_quiet(self) -> bool:
        """Whether nothing is under way, and nobody lacks anything: until the next digests nothing can happen."""
        replicas = [each.replica for participant in self.participants for each in participant.memory.opened_worlds()]
        busy = any(each._inbox or each.synchroniser.is_asking or not each.synchroniser.joined for each in replicas)
        stores = [participant.memory.replica.graph.store for participant in self.participants]
        alike = len({(store.context.hash, store.fingerprint) for store in stores}) == 1
        return alike and not busy and not self.network.is_due(LONG_TICK)

    def catch_up(self) -> None:
        """Give everybody the time to catch up; it passes in longer steps while nothing is under way."""
        end = self.clock.monotonic() + CATCH_UP
        while self.clock.monotonic() < end:
            self.advance(LONG_TICK if self.is_quiet else TICK)

    def advance(self, seconds: float) -> None:
        """Let time pass, in which everybody does what is due."""
        self.lived += seconds
        super().advance(seconds)
        self.worlds.note()

    # ---- steps

    def take(self, step: Step) -> None:
        """Let one step happen. Raises `AssertionError` if something is wrong then."""
        if step.kind in ("heal", "sleep", "pass"):
            self._take_time(step)
        elif not self._take_fault(step) and self.running:
            participant = self.running[step.place % len(self.running)]
            self._do(participant, lambda: self._take_work(step, participant.memory))

    def _take_time(self, step: Step) -> None:
        match step.kind:
            case "pass":
                self.advance(step.amount)
            case "heal":
                self.heal_all()
            case "sleep":
                self._met["all asleep"] += 1
                self.slept += step.amount
                self.clock.advance(step.amount)
                self.advance(TICK)

    def _take_work(self, step: Step, memory: Memory) -> None:
        """What users do."""
        place, choice = step.place, step.choice
        name = NAMES[choice % len(NAMES)]
        node, key = self.a_node(place, choice), self.an_edge(place, choice)
        world = WORLDS[choice % len(WORLDS)]
        match step.kind:
            case "add":
                self.add_node(place, name, "box" if choice % 5 == 0 else "cube", choice)
            case "batch":
                self.batch(place, [name, NAMES[(choice + 1) % len(NAMES)]], choice)
            case "update" if node:
                self.update_node(place, node, choice)
            case "take away" if node:
                self.remove_attribute(place, node, "seen" if choice % 2 else "mass")
            case "edge" if node and (other := self.a_node(place, choice >> 4)):
                self.add_edge(place, (node, other, "on" if choice % 3 == 0 else "RT"), choice)
            case "stream" if key:
                self.stream(place, key, choice)
            case "remove" if node:
                self.remove_node(place, node)
            case "remove edge" if key:
                self.remove_edge(place, key)
            case "mesh" if node:
                hash = self.meshes.put(memory, choice)
                self._write(place, lambda memory: memory.update_node(node, mesh=hash))
            case "ask for mesh":
                self.meshes.ask(memory, choice)
            case "make" | "open" | "delete" | "add there" | "update there" | "remove there":
                with contextlib.suppress(*HERE, ClockDriftError):
                    self._work_in_world(step.kind, memory, world, name, choice)
                self.worlds.note()

    def _work_in_world(self, kind: str, memory: Memory, world: str, name: str, choice: int) -> None:
        opened = next((each for each in memory.opened_worlds() if each.world_name == world), None)
        match kind:
            case "make" if choice >> 7 & 7 == 0:
                memory.create_world(world, exist_ok=True)
            case "make":
                there = [info.name for info in memory.worlds()]
                free = [each for each in WORLDS if each not in there] or [world]
                parent, follow = there[(choice >> 3) % len(there)], choice >> 6 & 1 == 1
                self.worlds.note_copied(memory.fork(free[choice % len(free)], of=parent, follow=follow))
            case "open":
                memory.world(world)
            case "delete":
                memory.delete_world(world)
            case "add there" if opened and name not in opened:
                opened.add_node(name, "cube", seen=choice, note=mark(opened))
            case "update there" if opened and name in opened:
                opened.update_node(name, mass=float(choice))
            case "remove there" if opened:
                opened.remove_node(name)

    def _take_fault(self, step: Step) -> bool:
        """A fault, or an end of one; false if the step is none."""
        names = [str(place) for place in range(self.places)]
        place, choice = step.place % self.places, step.choice
        match step.kind:
            case "lossy":
                worse = step.amount > 0.0
                faults = Faults(step.amount, 0.3 * worse, (0.0, 0.5) if choice % 2 and worse else (0.0, 0.02 * worse))
                self.network.faults = faults
            case "partition":
                self._met["partition"] += 1
                here = [name for name in names if choice >> int(name) & 1]
                self.network.partition(here, [name for name in names if name not in here])
            case "cut" if place != choice % self.places:
                self._met["one-way cut"] += 1
                self.network.cut(str(place), str(choice % self.places))
            case "mend":
                self.network.heal()
            case "suspend" if any(each.place == place for each in self.running):
                self._met["pause"] += 1
                self._stopped.add(place)
                self.network.suspend(str(place))
            case "resume":
                self._resume(place)
            case "offend":
                self._offend(step)
            case "clock" | "right clock":
                for participant in self.participants:
                    if participant.place == place:
                        self._met["clock set wrong"] += step.amount != 0.0
                        self._met["clock set back"] += step.amount < participant.clock.skew
                        participant.clock.skew = step.amount
                        self._skews.add(step.amount)
            case _:
                return self._take_end(step, place)
        return True

    def _take_end(self, step: Step, place: int) -> bool:
        """A fault of a process or a disk; false if the step is none."""
        disk = self.disks[place % len(self.disks)]
        running = {participant.place: participant for participant in self.running}
        match step.kind:
            case "kill" if place in running:
                self._lives[place].arm(int(step.amount))
            case "power" if place in running:
                self._met["power cut"] += 1
                self._cut_power(running[place])
            case "blackout":
                self._met["blackout"] += 1
                for participant in list(self.participants):
                    self._cut_power(participant)
            case "start" | "kill as it starts":
                if place in self._down:
                    self._start(place, int(step.amount) if step.kind == "kill as it starts" else None)
            case "full":
                self._met["full disk"] += 1
                disk.full = True
            case "errors":
                disk.errors = 0.5
            case "room":
                disk.full, disk.errors = False, 0.0
            case _:
                return step.kind in ("kill", "power", "cut", "suspend")
        return True

    def _cut_power(self, participant: Participant) -> None:
        self._bury(participant)
        if participant.place < len(self.disks):
            self.disks[participant.place].lose_power()

    def _resume(self, place: int) -> None:
        self._stopped.discard(place)
        self.network.resume(str(place))

    def _offend(self, step: Step) -> None:
        """Somebody says what is not true, or what it may not say."""
        running = self.running
        if not running:
            return
        self._met["offence"] += 1
        node = self.a_node(step.place, step.choice)
        if self.rogue is not None:
            self.rogue.offend(self.memory(step.place), step.choice)
        elif node is not None:
            stamp = max(1, int((self.clock.now() + (step.choice - 32768) * 10.0) * 1e6) << 10)
            self.forge(step.place, node, stamp, step.choice, durable=step.choice % 2 == 0)

    # ---- what must be so

    def heal_all(self) -> None:
        """End all faults, give everybody the time to catch up, and look whether all is as it must be."""
        for life in self._lives.values():
            life.disarm()
        for disk in self.disks:
            disk.full, disk.errors = False, 0.0
        for place in range(self.places):
            self._resume(place)
            if place in self._down:
                self._start(place)
        self.converge()
        self.check_converged()
        self.worlds.check()
        self.worlds.check_converged()
        self.meshes.check_converged(lambda: self.advance(TICK))
        self._check_bounded()

    def _check_bounded(self) -> None:
        """The state is as large as what it shows, and so are the folders."""
        first = self.participants[0].memory.replica.graph.store
        held = self._expected(first.context, first.entries).held()  # all hold the same: that was looked at before
        for participant in self.participants:
            graph = participant.memory.replica.graph
            assert graph.store.entries.keys() == held, "what nobody can see any more is kept"
            awaited = {rid for rid, _ in graph.store._waiting}
            assert awaited <= self.dead, "writes wait for what never comes, though who made it lives"
        for place in self.keepers:
            files = [path for path in self.disks[place].root.iterdir() if path.is_file()]
            assert len(files) <= MOST_FILES, f"{len(files)} files in a folder of the state"
            channels = self.keepers[place]._memory.world_channels()
            for world in (self.disks[place].root / "worlds").glob("*/*"):
                assert channels.get(world.parent.name) == world.name, "files of a deleted world are left"
