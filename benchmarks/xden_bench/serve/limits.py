"""How much the desk takes on, from one user and from all."""

from __future__ import annotations

import dataclasses
import os
import resource
from typing import Final

from xden1k.errors import DataError

__all__ = ["Limits", "be_modest"]

_NICENESS: Final = 5
"""So much behind the web server."""


@dataclasses.dataclass(frozen=True, slots=True)
class Limits:
    """Settings of the desk, read from TOML by :func:`xden1k.values.settings.load_settings`.

    Parameters
    ----------
    upload_mb
        Largest file that is taken, MB of 10⁶ bytes.
    upload_minutes
        Longest time that sending one file may take.
    incoming_mb
        Files that are being sent at the same time, of all users, MB of 10⁶ bytes. They lie in the
        state folder, and are gone when their sender is answered.
    jobs_per_user_hour
        Files that one user may send within an hour; whatever is queued counts, refused or not.
    queue_length
        Files that wait or are being checked, of all users.
    job_seconds
        Longest time that checking and scoring one file may take.
    job_memory_mb
        Most memory that it may take, MB of 10⁶ bytes; the libraries alone need 400. Held on Linux.
    spare_disk_mb
        What must stay free on the disk of the state folder after an upload, for everything else
        that writes there.

    Raises
    ------
    DataError
        If one is not a whole number above zero.

    Examples
    --------
    >>> Limits(upload_mb=100).upload_bytes
    100000000
    """

    upload_mb: int = 1000
    upload_minutes: int = 10
    incoming_mb: int = 4000
    jobs_per_user_hour: int = 6
    queue_length: int = 40
    job_seconds: int = 900
    job_memory_mb: int = 1000
    spare_disk_mb: int = 1000

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if type(value) is not int or value < 1:
                raise DataError(f"{name} must be a whole number above zero, got {value!r}")

    @property
    def upload_bytes(self) -> int:
        """Largest file that is taken."""
        return self.upload_mb * 10**6

    @property
    def incoming_bytes(self) -> int:
        """Files that are being sent at the same time."""
        return self.incoming_mb * 10**6

    @property
    def job_memory_bytes(self) -> int:
        """Most memory that checking and scoring one file may take."""
        return self.job_memory_mb * 10**6

    @property
    def spare_disk_bytes(self) -> int:
        """What must stay free on the disk."""
        return self.spare_disk_mb * 10**6


def be_modest(memory_bytes: int) -> None:
    """Bound the memory of this process, write no image of it when it dies, and let others go first.

    The limit is on data (heap and private memory), not on addresses, which libraries and threads
    reserve by the gigabyte and never touch.

    Parameters
    ----------
    memory_bytes
        At most so much; never more than there may be already.
    """
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    limit = memory_bytes if most == resource.RLIM_INFINITY else min(memory_bytes, most)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(_NICENESS)
