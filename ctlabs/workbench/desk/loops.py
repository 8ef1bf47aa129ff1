"""What a draft does with its regulator beyond what a slider shows at once: curves of trade-offs, an ensemble of its loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ctlabs.workbench.desk.records import Drafted, Show
from ctlabs.workbench.runs.running import Running
from ctlabs.workbench.runs.worker import here

if TYPE_CHECKING:
    from ctlabs.regulation.runs import LoopEnsemble
    from ctlabs.workbench.runs.loops import LoopCurves
    from ctlabs.workbench.runs.worker import Cancel

#: How long a cancelled run may take to come to its next regulator, s.
PATIENCE = 5.0


class LoopDesk:
    """The regulator of one draft.

    ``running``, the ensemble · ``ensemble`` and ``curves``, the last ones, with the texts that they are of · ``runs`` and ``seed``, asked
    for last · ``set_points``, of the outputs whose set point was given, 1 elsewhere
    """

    def __init__(self, session: Drafted) -> None:
        self.session = session
        self.running = Running()
        self.ensemble: tuple[str, LoopEnsemble] | None = None
        self.curves: tuple[str, LoopCurves] | None = None
        self.runs, self.seed = 1000, 1
        self.set_points: dict[str, float] = {}

    async def run(self, runs: int, seed: int, progress: Show | None = None, cancel: Cancel | None = None) -> None:
        """Run the loop of the present model many times."""
        text = self.session.file.checked().dumps()
        self.runs, self.seed = runs, seed
        self.ensemble = text, await self._run("loop_ensemble", {"model": text, "runs": runs, "seed": seed}, progress, cancel)

    async def draw(self, text: str, cancel: Cancel | None = None) -> None:
        """The curves of a model's text."""
        if self.curves is None or self.curves[0] != text:
            found = await self._run("loop_curves", {"model": text}, None, cancel)
            self.curves = text, found

    async def _run(self, name: str, arguments: dict[str, Any], progress: Show | None, cancel: Cancel | None) -> Any:
        runner = self.session.runner
        if runner is None:
            return await here(name, arguments)
        given: dict[str, Any] = {"session": self.session.draft.id, "progress": progress, "cancel": cancel, "patience": PATIENCE}
        return await runner.run(name, arguments, **given)
