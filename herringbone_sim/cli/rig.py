"""``rig``: campaigns of a simulated rig with effects, to practise on."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.cli.options import add_file, add_number, add_out
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
MAKE = """\
python -m herringbone_sim rig make --out rigs/ripple --effect runout@rp:amplitude=2e-5,member=ring
python -m herringbone_sim rig make --out rigs/mine --hidden --seed 7
"""
EXAMPLES = LIST + MAKE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add ``rig effects`` and ``rig make``."""
    actions = parser.add_subparsers(title="what to do", required=True, metavar="ACTION")
    lister = add_verb(actions, "effects", LISTED, LIST, help="list effects and their parameters")
    lister.set_defaults(action=print_effects)
    text = "write a campaign and its label"
    maker = add_verb(actions, "make", DESCRIPTION, MAKE, help=text)
    add_make_options(maker)
    maker.set_defaults(action=make)


def run(args: argparse.Namespace) -> int:
    """Do what the second word says; its exit code."""
    return int(args.action(args))


def add_make_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``rig make``."""
    add = parser.add_argument
    add_out(parser, "campaign to write")
    text = "folder of labels (default: 'labels' beside the campaign's folder)"
    add("--labels", type=Path, metavar="DIR", help=text)
    add_file(parser, "--parameters", "nominal gear (default: the nominal rig)")
    add("--effect", action="append", default=[], metavar="TEXT", help="once or more, see above")
    add("--hidden", action="store_true", help="draw the effects by the seed")
    add_number(parser, "--runs", 8, "runs")
    add_number(parser, "--held-out", 3, "of them, of role held_out")
    add_number(parser, "--cycles", 120, "mesh cycles of a run")
    add_number(parser, "--snr", 40.0, "signal-to-noise ratio of every channel", "DB")
    add_number(parser, "--bits", 16, "of the converter; 0: none")
    add_number(parser, "--tolerance", 0.02, "of the parameters, as a share", "SHARE")
    add_number(parser, "--seed", 0, "of all random numbers")
    text = "index of further runs of the rig of that seed, at other operating points: 1, 2, ..."
    add_number(parser, "--later", 0, text)
    text = "channels that the rig has sensors for, such as u_s_L,u_s_R,u_c (default: all)"
    add("--channels", default="", metavar="NAMES", help=text)


def make(args: argparse.Namespace) -> int:
    """Write the campaign and its label, print the hash of the label; exit code 0.

    Raises:
        ParameterError: effects beside --hidden, or no such effect.
        RecordingError: labels inside the campaign.
    """
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


def print_effects(_: argparse.Namespace) -> int:
    """Print every effect with its parameters and options."""
    for effect in effects().values():
        print(f"{effect.id} ({effect.level}): {effect.text}")
        for p in effect.parameters:
            print(f"    {p.name} [{p.unit}] {p.low:g} .. {p.high:g}: {p.text}")
        for o in effect.options:
            choices = ", ".join(str(choice) for choice in o.choices)
            print(f"    {o.name}: {o.text}{f' ({choices})' if choices else ''}")
    return 0
