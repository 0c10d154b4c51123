"""The help of a command with many options: those that matter first, the others in panels."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

MANY = 13
"""Number of options, ``--help`` among them, from which on they are listed in panels."""
PANELS = {
    "Devices": "projector camera exposure-ms gain-db pixel-format",
    "Frames": "frames auto-exposure hdr average fast most-saturated resume until most-captures "
    "plan setup steps "
    "set channels mosaic white-balance reference object black white mask background "
    "camera-name projector-name noise gain saturation min-modulation modulation",
    "Scene": "shape size height-mm fringes gamma bits ambient paint seed matrix",
    "Geometry": "rig projector-size axes axis depth blur-px epipolar-px geometry distance-mm "
    "baseline-mm pitch-mm-per-px sign principal-px plane-coordinates plane-equation "
    "plane-sigma-mm period-px bright-px board "
    "turntable turn distortion model align datum-point datum-plane fit-box reach-mm tolerance-mm "
    "scale face in robot-pose poses-as",
    "Method": "live method option against denoise zero response estimate-response estimate-steps "
    "relative phases unwrap contrast channel adjust learn false-alarms kind min-period max-period "
    "camera-pixel robust colours "
    "quantity part operator scan-parts operators trials names tolerance-width calibrated "
    "calibrated-sigma spread share",
    "Output": "out capture ply figure panel no-title report head json csv markdown timing force "
    "history watched title part-reports excel",
    "Work": "recipe workers scheduler memory-gb watch",
}
"""Names of options by panel. An option means the same in every command, so it has one panel."""
FIRST = {
    "batch": "recipe out report workers resume",
    "calibrate": "board out live setup figure",
    "capture": "setup out hdr average resume",
    "check": "rig board adjust out json",
    "compare": "method object shape figure json",
    "decode": "plan steps response out figure",
    "deviation": "model rig tolerance-mm align figure",
    "light": "plan contrast out figure json",
    "measure": "rig depth out ply figure",
    "plan": "frames projector-size setup rig out",
    "projector": "rig out distortion plan noise",
    "reconstruct": "reference object method out figure",
    "response": "plan set camera-name projector-name out",
    "scan": "setup rig capture out hdr",
    "study": "quantity tolerance-width calibrated report json",
    "watch": "rig watched learn false-alarms json",
    "simulate": "shape size noise bits out",
}
"""The five options of every command with many that people use first."""


class PanelCommand(TyperCommand):
    """A command whose options are listed in panels where they are many."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, the options that matter first, and those of each panel."""
        known = {p.opts[0]: p for p in self.get_params(ctx)}
        options = [name for name, p in known.items() if p.param_type_name == "option"]
        if len(options) < MANY:
            super().format_options(ctx, formatter)
            return
        first = [f"--{name}" for name in FIRST[str(self.name)].split()]
        panels = {
            "Arguments": [name for name in known if name not in options],
            "Options": [*first, "--help"],
        }
        for title, names_in in PANELS.items():
            panels[title] = [f"--{name}" for name in names_in.split() if f"--{name}" not in first]
        for title, names in panels.items():
            shown = [known[name].get_help_record(ctx) for name in names if name in known]
            if shown:
                with formatter.section(title):
                    formatter.write_dl(shown)
