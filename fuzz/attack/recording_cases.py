"""Recordings that were cut, flipped or packed again with another inside, given to every verb that reads them."""

import mcap_edits
import mcap_file
from harness import Answer, Case, World, digest, tells

# Verbs as they are given the recording `x.mcap`, and what they write. `whole.mcap` is the same recording, undamaged.
VERBS = {
    "impacts": (["impacts", "x.mcap"], []),
    "impacts json": (["impacts", "x.mcap", "--json"], []),
    "impacts against": (["impacts", "x.mcap", "--against", "whole.mcap"], []),
    "export": (["export", "x.mcap", "-o", "tables", "--format", "csv"], ["tables"]),
    "export window": (["export", "x.mcap", "-o", "contacts.csv", "--tables", "contacts", "--from", "0.2ms", "--to", "0.4ms"], ["contacts.csv"]),
    "export parquet": (["export", "x.mcap", "-o", "parquet-tables"], []),
    "diff": (["diff", "whole.mcap", "x.mcap"], []),
    "diff back": (["diff", "x.mcap", "whole.mcap"], []),
    "verify": (["replay", "x.mcap", "--verify"], []),
    "repair": (["replay", "x.mcap", "--repair", "-o", "again.mcap"], []),
    "snapshot": (["snapshot", "x.mcap", "--at", "0.3ms", "-o", "x.svg"], ["x.svg"]),
    "snapshot strip": (["snapshot", "x.mcap", "--at", "0.1ms..0.3ms/3", "--around", "3", "-o", "x.svg", "--joints"], ["x.svg"]),
    "snapshot exact": (["snapshot", "x.mcap", "--at", "0.31ms", "--exact", "-o", "x.svg"], ["x.svg"]),
    "explain": (["explain", "x.mcap", "--link", "3", "--at", "0.3ms"], []),
    "explain impact": (["explain", "x.mcap", "--impact", "1"], []),
    "zoom": (["zoom", "x.mcap", "--from", "0.3ms", "--to", "0.33ms", "-o", "zoom.mcap"], []),
    "view": (["view", "x.mcap", "-o", "x.rrd"], []),
    "resume": (["run", "--resume", "x.mcap", "--duration", "0.1ms", "--no-output", "--json"], []),
}
COSTLY_FOR_SMARTCHAIN = {"verify", "snapshot exact", "explain", "explain impact", "zoom", "resume"}
SEED_WEIGHTS = {"bush": 10, "bush-dense": 5, "bush-long": 2, "silent": 4, "smartchain": 1, "sensors": 3}


def learn_answers(world: World, make_case) -> None:
    """What every verb says of every undamaged recording. What is not the same twice is not compared."""
    for name in world.recordings:
        for verb in verbs_for(name):
            seen = []
            for turn in range(2):
                case = make_case(f"seed-{name}-{verb.replace(' ', '-')}", turn)
                _place(case, name, world.recordings[name].read_bytes())
                result = case.run(*VERBS[verb][0])
                if case.violations or result.code != 0:
                    raise SystemExit(f"an undamaged recording does not pass: {result.command}: exit code {result.code}\n{result.stderr}")
                seen.append(Answer(_without_timing(result.stdout), _files(case, verb)))
            if seen[0] == seen[1]:
                world.answers[name, verb] = seen[0]


def verbs_for(name: str) -> list[str]:
    return [verb for verb in VERBS if not (name == "smartchain" and verb in COSTLY_FOR_SMARTCHAIN)]


def cut(case: Case) -> None:
    name = _choose_seed(case)
    data = case.world.recordings[name].read_bytes()
    records = mcap_file.record_offsets(data)
    ends = [offset for _, offset in records]
    position = case.rng.choice([case.rng.randrange(len(data)), case.rng.choice(ends) + case.rng.randrange(-3, 12)])
    position = max(0, min(position, len(data) - 1))
    last_chunk_end = ends[max(i for i, (opcode, _) in enumerate(records) if opcode == mcap_file.CHUNK) + 1]
    _attack(case, name, data[:position], f"{name} cut at {position}", lost=position < last_chunk_end)


def flipped(case: Case) -> None:
    name = _choose_seed(case)
    data = bytearray(case.world.recordings[name].read_bytes())
    summary = next(offset for opcode, offset in mcap_file.record_offsets(bytes(data)) if opcode == mcap_file.DATA_END)
    first, last = case.rng.choice([(0, len(data)), (summary, len(data)), (0, 5000), (len(data) - 1200, len(data))])
    places = [case.rng.randrange(first, last) for _ in range(case.rng.choice([1, 1, 1, 2, 5, 20]))]
    for place in places:
        data[place] ^= 1 << case.rng.randrange(8)
    _attack(case, name, bytes(data), f"{name} flipped at {', '.join(map(str, sorted(places)))}")


def repacked(case: Case) -> None:
    name = _choose_seed(case)
    recording = mcap_file.unpack(case.world.recordings[name].read_bytes())
    edit = case.rng.choice(mcap_edits.EDITS)
    counts = recording.counts if case.rng.random() < 0.4 else None
    detectable = edit(case.rng, recording)
    label = f"{edit.__name__} in {name}, counts {'kept' if counts else 'brought up to date'}"
    if name == "bush-dense" and edit in (mcap_edits.frames_removed, mcap_edits.chunks_removed):
        detectable = counts is not None  # its frames are unevenly spaced by themselves
    _attack(case, name, mcap_file.pack(recording, counts), label, compared=detectable)


def bombs(case: Case) -> None:
    recording = mcap_file.unpack(case.world.recordings["bush"].read_bytes())
    edit = case.rng.choice(mcap_edits.BOMBS)
    edit(case.rng, recording)
    _attack(case, "bush", mcap_file.pack(recording), edit.__name__, compared=False)


def _attack(case: Case, name: str, data: bytes, label: str, lost: bool = False, compared: bool = True) -> None:
    """Give the changed recording to some verbs. `lost`: messages were removed for certain."""
    case.note(label)
    _place(case, name, data)
    for verb in case.rng.sample(verbs_for(name), 2):
        result = case.run(*VERBS[verb][0])
        answer = case.world.answers.get((name, verb))
        if answer is None or result.code != 0 or not compared:
            continue
        told = tells(result, answer.stdout)
        same = answer == Answer(_without_timing(result.stdout), _files(case, verb))
        if not same and not told:
            case.fail(f"silent wrong answer (no word of another answer than on the whole recording): {result.command}")
        elif lost and not told:
            case.fail(f"silence (the answer is right, but no word that messages are missing): {result.command}")
    if case.path("x.mcap").read_bytes() != data:
        case.fail("x.mcap was changed by a verb that reads it")


def _place(case: Case, name: str, data: bytes) -> None:
    case.write("x.mcap", data)
    case.path("whole.mcap").symlink_to(case.world.recordings[name])


def _choose_seed(case: Case) -> str:
    names = list(case.world.recordings)
    return case.rng.choices(names, [SEED_WEIGHTS[name] for name in names])[0]


def _files(case: Case, verb: str) -> str:
    return digest(*(path for path in map(case.path, VERBS[verb][1]) if path.exists()))


def _without_timing(stdout: str) -> str:
    """Computing time is in the first line of a run, and in the JSON of one."""
    return "\n".join(line for line in stdout.splitlines() if "per simulated second" not in line and "wall" not in line and "cpu" not in line)
