"""``gaussian-property-surface-net``: GaussianProperty's vote, asked of the surface network.

The network that :mod:`.predictor` trains stands in the place of the original's vision model: what
the same regions, the same vote and the same solid filling are worth with the best eye that the
training split gives.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from xden1k.errors import DataError
from xden1k.predictor import Budget, Examples
from xden_baselines.chat.candidates import Picture
from xden_baselines.chat.settings import ChatSettings
from xden_baselines.gaussian_property.library import ClosedList, closed_list
from xden_baselines.gaussian_property.predictor import GaussianProperty
from xden_baselines.gaussian_property.regions import Segmentation
from xden_baselines.gaussian_property.voters import Answer
from xden_baselines.surface.predictor import SurfaceNet

if TYPE_CHECKING:
    from xden_baselines.surface.network import PixelNetwork

__all__ = ["GaussianPropertySurfaceNet", "NetworkVoter"]

FILE = "materials.json"


@dataclass(frozen=True, slots=True, eq=False)
class NetworkVoter:
    """Takes the material that a network names over a whole region.

    Parameters
    ----------
    network
        In evaluation mode, on the device.
    threads, device
        Of torch.
    """

    network: PixelNetwork
    threads: int = 1
    device: str = "cpu"

    source = "surface-net names materials"

    def vote(
        self, object_id: str, picture: Picture, segmentation: Segmentation
    ) -> tuple[Answer, ...]:
        """Answer for each region, from the first: the largest mean probability over its pixels."""
        from xden_baselines.surface.inference import shares

        found = shares(self.network, picture, segmentation > 0, self.threads, self.device)
        means = (
            found[segmentation == number].mean(axis=0, dtype=np.float64)
            for number in range(1, int(segmentation.max()) + 1)
        )
        return tuple(Answer(int(mean.argmax()), float(mean.max().clip(0, 1))) for mean in means)


class GaussianPropertySurfaceNet(GaussianProperty):
    """GaussianProperty style, its regions named by the network of surface-net.

    Parameters
    ----------
    network
        Folder of a saved fit of ``surface-net`` on the same training split, to be taken instead of
        training; empty = one is trained.
    settings
        Fields of :class:`xden_baselines.surface.settings.Settings`.

    Raises
    ------
    DataError
        If a setting is out of its range.
    """

    name = "gaussian-property-surface-net"
    version = "1"
    external_data = False

    _net: SurfaceNet

    def __init__(self, *, network: str = "", **settings: Any) -> None:
        self._chat = ChatSettings()  # whatever is configured: the network answers
        self._folder, self._net = network, SurfaceNet(**settings)

    @property
    def fingerprint(self) -> str:
        """The settings, and the weights that are taken up."""
        if not self._folder:
            return self._net.fingerprint
        from xden_baselines.learning.checkpoint import WEIGHTS_FILE, check_files

        check_files(Path(self._folder))
        with (Path(self._folder) / WEIGHTS_FILE).open("rb") as file:
            weights = hashlib.file_digest(file, "sha256").hexdigest()
        return f"{self._net.fingerprint} {weights}"

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        """List the materials of the training split; train the network, or take it up.

        Raises
        ------
        DataError
            As ``surface-net``, or if the network knows other materials.
        """
        if self._folder:
            self._net.load(Path(self._folder))
        else:
            self._net.fit(train, seed=seed, budget=budget)
        self._named(closed_list(train))

    def save(self, folder: Path) -> None:
        """Write the network as ``surface-net`` does, and the list of materials."""
        self._net.save(folder)
        text = json.dumps(asdict(self._materials), indent=1)
        (folder / FILE).write_text(text + "\n", encoding="utf-8")

    def load(self, folder: Path) -> None:
        """Take up what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the folder does not hold it.
        """
        from xden_baselines.learning.checkpoint import load_report

        materials = load_report(folder / FILE, ClosedList, "fit of such a method")
        self._net.load(folder)
        self._named(materials)

    def _named(self, materials: ClosedList) -> None:
        network, settings = self._net.network, self._net.settings
        if network.materials != materials.names:
            raise DataError(
                f"{self._folder or self.name}: expected a network of the training split's "
                f"{len(materials)} materials, got one of {len(network.materials)} others"
            )
        self._materials = materials
        self._voter = NetworkVoter(network, settings.threads, settings.device)
        self._notes = f"{self._net.notes}; {self.masks}"
