"""Judges the results of a set: which names are right, which are false, and how good the numbers are."""

import fnmatch
import json
from statistics import median

CLEAR = 3.0  # size over noise
FORMS = ("stick_speed", "start", "slip", "order")  # numbers of an effect that are not scored
SURE = 1.96

COLUMNS = [
    ("cases", "cases"),
    ("clear", "clear cases: every effect more than three times the noise"),
    ("first", "of the clear: the first name is a true one or a twin"),
    ("holds", "of the clear: names and alternatives (of any outcome) hold all true ones"),
    ("named", "of the clear: NAMED, and all true ones are among the names"),
    ("names", "names given as NAMED, all cases"),
    ("false", "of them false"),
    ("part", "names given as PART: something else is left"),
    ("part_false", "of them false"),
    ("unsure", "names given as LEAD or AMBIGUOUS"),
    ("unsure_false", "of them false, with their alternatives"),
    ("silent", "outside and clean cases: without a name"),
    ("near", "outside cases: only names that are near"),
    ("course", "warming cases: the true effect is told to vary, named or not"),
    ("sizes", "sizes of effects found: intervals"),
    ("sizes_hold", "of them hold the truth"),
    ("sure_sizes", "sizes of sets that are NAMED, lack nothing and hold nothing false: intervals"),
    ("sure_hold", "of them hold the truth"),
    ("inertias", "inertias of machines whose effects are all found: intervals"),
    ("inertias_hold", "of them hold the truth"),
    ("cut", "searches that the budget ended"),
    ("timeouts", "time-outs"),
    ("panics", "panics and signals"),
    ("errors", "refused with an error"),
]


def read_set(folder, only):
    """Pairs of truth and result."""
    lines = (folder / "results.jsonl").read_text().splitlines()
    results = [json.loads(line) for line in lines]
    pairs = []
    for result in results:
        if fnmatch.fnmatch(result["id"], only):
            truth = json.loads((folder / "truth" / f"{result['id']}.json").read_text())
            pairs.append((truth, result))
    return pairs


def accepted(truth, effect):
    """A true effect and its twins."""
    return {effect} | {t["name"] for t in truth["twins"] if t["of"] == effect}


def is_clear(truth):
    sizes = [v for name, v in truth["size_over_noise"].items() if name != "all"]
    return bool(sizes) and min(sizes) > CLEAR


def judge(truth, result):
    """What one case adds to the table, and a line if something is wrong."""
    out = dict.fromkeys([key for key, _ in COLUMNS], 0)
    out["cases"] = 1
    if result["end"] != "report":
        key = {"time-out": "timeouts", "error": "errors"}.get(result["end"], "panics")
        out[key] = 1
        out["clear"] = int(is_clear(truth) and bool(truth["effects"]))
        return out, f"{result['end']} {result.get('message', '').strip()[:200]}"
    out["cut"] = int(result["budget_spent"])
    sets = [{e["path"], *e["rivals"]} for e in result["effects"]]
    right = set(truth["effects"]) | {t["name"] for t in truth["twins"]}
    found = [effect for effect in truth["effects"] if any(accepted(truth, effect) & s for s in sets)]
    for effect, names in truth["together"].items():
        if set(names) <= set().union(*sets):
            right |= set(names)
            found += [effect] if effect not in found else []
    wrong = [e["path"] for e, s in zip(result["effects"], sets, strict=True) if not s & right]
    sure = result["outcome"] == "named"
    given = {"named": ("names", "false"), "part": ("part", "part_false")}
    count, false = given.get(result["outcome"], ("unsure", "unsure_false"))
    out[count], out[false] = len(sets), len(wrong)
    problems = [f"false {name}" for name in wrong]
    if truth["effects"]:
        problems += judge_found(truth, result, found, sets, out)
    else:
        out["silent"] = int(not sure or not sets)
        out["near"] = int(bool(sets) and sure and all(near(truth, name) for name in wrong))
    if truth["course"]:
        true = set().union(*(accepted(truth, effect) for effect in truth["effects"]))
        out["course"] = int(any(v["path"].rsplit(".", 1)[0] in true for v in result["varying"]))
    judge_numbers(truth, result, found, sure and len(found) == len(truth["effects"]) and not wrong, out)
    return out, "; ".join(problems)


def judge_found(truth, result, found, sets, out):
    """Whether the true effects of a case are found."""
    missed = [effect for effect in truth["effects"] if effect not in found]
    if not is_clear(truth):
        return []
    out["clear"] = 1
    first = {name for effect in truth["effects"] for name in accepted(truth, effect)}
    first |= {name for effect in found for name in truth["together"].get(effect, [])}
    out["first"] = int(bool(result["effects"]) and result["effects"][0]["path"] in first)
    out["holds"] = int(not missed)
    out["named"] = int(not missed and result["outcome"] == "named")
    told = [f"missed {effect}" for effect in missed]
    if not missed and not out["named"]:
        told.append("not sure")
    if sets and not out["first"]:
        told.append(f"first is {result['effects'][0]['path']}")
    return told


def near(truth, name):
    return name.split(".")[1] in truth["near"]


def judge_numbers(truth, result, found, complete, out):
    """Counts the intervals of sizes and of inertias."""
    for effect in result["effects"]:
        # Sizes that differ from record to record, as those of most causes outside the catalogue, are no constants.
        if effect["path"] not in found or effect["path"] not in truth["effects"]:
            continue
        if truth["course"] or truth["kind"] == "outside":
            continue
        values = {p["path"].rsplit(".", 1)[1]: p for p in effect["parameters"] if not p["at_bound"]}
        for key, true in truth["effects"][effect["path"]].items():
            if key in values and not key.startswith(FORMS):
                is_held = int(holds(key, true, values, truth["effects"][effect["path"]]))
                out["sizes"] += 1
                out["sizes_hold"] += is_held
                if complete:
                    out["sure_sizes"] += 1
                    out["sure_hold"] += is_held
    for number in result["numbers_after"]:
        path = number["path"]
        if complete and path in truth["numbers"] and path.startswith(("rotors", "sliders")):
            out["inertias"] += 1
            off = abs(number["value"] - truth["numbers"][path])
            out["inertias_hold"] += int(off <= SURE * number["standard_error"])


def holds(key, true, values, numbers):
    """Whether an interval holds the truth. A wave may be negative and half a turn on."""
    value, error = values[key]["value"], values[key]["standard_error"]
    wave = next((k for k in values if "phase_deg" in numbers and k != "phase_deg" and k in numbers), None)
    if wave:
        turned = values[wave]["value"] * numbers[wave] < 0.0
        if key == "phase_deg":
            off = (value - true + (180.0 if turned else 0.0) + 180.0) % 360.0 - 180.0
            return abs(off) <= SURE * error
        value = -value if turned else value
    return abs(value - true) <= SURE * error


def table(folder, only):
    """Counts by kind, and the cases with something wrong."""
    counts, walls, failing = {}, {}, []
    for truth, result in read_set(folder, only):
        row, problem = judge(truth, result)
        for kind in (truth["kind"], "all"):
            total = counts.setdefault(kind, dict.fromkeys(row, 0))
            for key, value in row.items():
                total[key] += value
            walls.setdefault(kind, []).append(result["wall_s"])
        if problem:
            sizes = ", ".join(f"{v:.2g}" for k, v in truth["size_over_noise"].items() if k != "all")
            given = result.get("outcome", result["end"]).upper()
            given += " (cut)" if result.get("budget_spent") else ""
            failing.append(f"{result['id']:20} {truth['class']} ({sizes}): {given}, {problem}")
    kinds = sorted(k for k in counts if k != "all") + ["all"]
    lines = [" " * 14 + "".join(f"{kind[:9]:>10}" for kind in kinds)]
    for key, _ in COLUMNS:
        lines.append(f"{key:14}" + "".join(f"{counts[kind][key]:10}" for kind in kinds))
    lines.append(f"{'wall median s':14}" + "".join(f"{median(walls[kind]):10.1f}" for kind in kinds))
    lines.append(f"{'wall max s':14}" + "".join(f"{max(walls[kind]):10.1f}" for kind in kinds))
    lines += ["", *[f"{key:14}{text}" for key, text in COLUMNS], "", "failing cases (sizes over noise):", *failing]
    return "\n".join(lines)
