"""``rig``: recordings of a made-up rig, to practise on."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, obstacle_text, obstacles
from herringbone_sim.effects.registry import effects
from herringbone_sim.effects.written import parse_effect
from herringbone_sim.errors import ParameterError, RecordingError
from herringbone_sim.recording.parameter_file import load_gear
from herringbone_sim.recording.rig import RigPlan, hidden_effects, make_campaign, write_label

DESCRIPTION = """\
Make a rig: `rig make` writes a campaign (runs as bags, campaign.yaml) of a gear that differs from
the nominal one by its tolerance and by effects, and its label to another folder.

An effect is ID, ID@MESH/PLANET/SIDE or ID@MESH/PLANET/SIDE:NAME=VALUE,...; what is left out of
the place is all, what is left out of the values has its start value; several channels of a sensor
stand as channels=F_sp1_L+F_sp2_L. `rig effects` lists all.
"""
LISTED = "List the effects with their parameters, units and bounds."
LIST = "python -m herringbone_sim rig effects\n"
EXAMPLES = """\
python -m herringbone_sim rig make --out rigs/ripple --effect runout@rp:amplitude=2e-5,member=ring
python -m herringbone_sim rig make --out rigs/mine --hidden --seed 7
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``rig``."""
    parser = add_verb(subparsers, "rig", DESCRIPTION, LIST + EXAMPLES)
    deeds = parser.add_subparsers(title="what to do", required=True, metavar="DEED")
    listed = add_verb(deeds, "effects", LISTED, LIST, help="list effects and their parameters")
    listed.set_defaults(func=show_effects)
    text = "write a campaign and its label"
    made = add_verb(deeds, "make", DESCRIPTION, EXAMPLES, help=text)
    made.add_argument("--out", type=Path, required=True, metavar="DIR", help="campaign to write")
    made.add_argument(
        "--labels",
        type=Path,
        metavar="DIR",
        help="folder of labels (default: 'labels' beside the campaign's folder)",
    )
    made.add_argument(
        "--parameters", type=Path, metavar="FILE", help="nominal gear (default: the nominal rig)"
    )
    made.add_argument(
        "--effect", action="append", default=[], metavar="TEXT", help="once or more, see above"
    )
    made.add_argument("--hidden", action="store_true", help="draw the effects by the seed")
    made.add_argument("--runs", type=int, default=8, help="runs (default: 8)")
    made.add_argument("--held-out", type=int, default=3, help="of them, kept out (default: 3)")
    made.add_argument("--cycles", type=int, default=120, help="mesh cycles a run (default: 120)")
    made.add_argument("--snr", type=float, default=40.0, metavar="DB", help="default: 40 dB")
    made.add_argument("--bits", type=int, default=16, help="of the converter; 0: none")
    made.add_argument("--tolerance", type=float, default=0.02, help="share (default: 0.02)")
    made.add_argument("--seed", type=int, default=0, help="of all that is drawn (default: 0)")
    made.add_argument(
        "--later",
        type=int,
        default=0,
        metavar="N",
        help="further runs of the rig of that seed, at other operating points: day 1, 2, ...",
    )
    made.add_argument(
        "--channels",
        default="",
        metavar="NAMES",
        help="of meshes and bodies that the rig has sensors for, such as u_s_L,u_s_R,u_c "
        "(default: all)",
    )
    made.set_defaults(func=make)


def make(args: argparse.Namespace) -> int:
    """Write the campaign and its label; tell the seal of the label."""
    nominal, written = load_gear(args.parameters) if args.parameters else (Parameters(), ())
    nominal = nominal.changed({"model": "full", "samples_per_cycle": 24})
    actives = (*written, *(parse_effect(text) for text in args.effect))
    if args.hidden and actives:
        raise ParameterError("either --hidden or effects of one's own: leave one out")
    if args.hidden:
        actives = hidden_effects(args.seed, build(nominal))
    name = args.out.name
    labels = args.labels or args.out.absolute().parent / "labels"
    if (
        labels.absolute() == args.out.absolute()
        or args.out.absolute() in labels.absolute().parents
    ):
        raise RecordingError(f"labels must lie outside the campaign, got {labels}: set --labels")
    plan = RigPlan(
        nominal=nominal,
        actives=actives,
        runs=args.runs,
        held_out=args.held_out,
        cycles=args.cycles,
        noise_share=10.0 ** (-args.snr / 20.0),
        bits=args.bits,
        tolerance=args.tolerance,
        seed=args.seed,
        later=args.later,
        channels=tuple(name.strip() for name in args.channels.split(",") if name.strip()),
    )
    for rule in obstacles(nominal):
        print(f"note: {obstacle_text(rule)}")
    label = make_campaign(args.out, plan, name)
    seal = write_label(labels, name, label)
    print(f"written: {args.out} ({args.runs} runs)")
    print(f"label: {labels / name}.json, sha256 {seal}")
    return 0


def show_effects(_: argparse.Namespace) -> int:
    """Print every effect with its parameters."""
    for one in effects().values():
        print(f"{one.id} ({one.level}): {one.text}")
        for p in one.parameters:
            print(f"    {p.name} [{p.unit}] {p.low:g} .. {p.high:g}: {p.text}")
        for o in one.options:
            choices = ", ".join(str(choice) for choice in o.choices)
            print(f"    {o.name}: {o.text}{f' ({choices})' if choices else ''}")
    return 0
