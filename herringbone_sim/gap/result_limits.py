"""What limits the results of a campaign: unknown noise, roles, number of runs, quantities."""

from __future__ import annotations

from collections.abc import Sequence

from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding


def limit_findings(campaign: PreparedCampaign, noise_ratio: float) -> list[Finding]:
    """Findings on what limits the results: unknown noise, roles, number of runs, quantities.

    Fatal if there is no run of role ``fit``.

    Args:
        noise_ratio: noise over what the campaign gave; 1 if it gave none, or the same.
    """
    findings = []
    if not campaign.noise_known:
        reason = "campaign.yaml gives no noise"
        if noise_ratio != 1.0:
            reason = (
                f"channels have {noise_ratio:.2g} times the white noise that campaign.yaml gives"
            )
        text = (
            f"{reason}: it was estimated from spectra, from the consistency of "
            "the channels and from the residual of the force law; smaller effects are not seen, "
            "and closure is as uncertain as this estimate"
        )
        findings.append(Finding("noise", "", (), None, text, limit=True))
    fit, held_out = campaign.of_role("fit"), campaign.of_role("held_out")
    if not fit:
        text = "no run has the role fit: nothing can be learnt from this campaign"
        findings.append(Finding("no_fit", "", (), None, text, fatal=True))
    if not held_out:
        text = "no run is held out: whether the gap shrinks on new data is not known"
        findings.append(Finding("no_held_out", "", (), None, text, limit=True))
    if len(fit) == 1:
        text = (
            f"{fit[0].name} is the only run to fit: thirds of it take the place of runs left out, "
            "and effects of load, heat and speed can't be told from constant ones"
        )
        findings.append(Finding("one_run", fit[0].name, (), None, text, limit=True))
    return findings + _quantity_limits(fit)


def _quantity_limits(runs: Sequence[PreparedRun]) -> list[Finding]:
    """Findings on limits because mesh forces, rates, or x together with u were not recorded.

    Args:
        runs: fit runs; without any there are no findings.

    Returns:
        Up to three findings of the kind ``scope`` on the whole campaign, with ``limit`` set.
    """
    texts = []
    forced = any(run.F.recorded.any() or run.pin.recorded.any() for run in runs)
    if runs and not forced:
        texts.append(
            "there are no mesh forces: law and balance show only together, by accelerations; "
            "errors of force sensors can't be seen, nor a single mesh on its own"
        )
    elif runs and not all(run.F.complete or run.pin.recorded.any() for run in runs):
        names = runs[0].model.layout.meshes
        absent = [
            n for n, *on in zip(names, *(r.F.recorded for r in runs), strict=True) if not all(on)
        ]
        texts.append(
            f"forces of {', '.join(absent)} are not there in every run: less can be told of these "
            "meshes"
        )
    if runs and not all(run.v.complete or not run.x.recorded.any() for run in runs):
        texts.append("rates are not all there: damping rests on differences of displacements")
    if runs and not any(run.x.recorded.any() and run.u.recorded.any() for run in runs):
        texts.append(
            "x and u don't check each other: an error of a motion sensor shows against the law of "
            "the gear alone"
            if all(run.shafts_known for run in runs)
            else "x and u don't check each other: sensor errors can't be told from motion"
        )
    return [Finding("scope", "", (), None, text, limit=True) for text in texts]
