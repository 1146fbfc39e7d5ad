"""Where the files lie that ship beside the package: checkpoints and configurations."""

from pathlib import Path

from nsdr.errors import DataError


def shipped_folders(name: str) -> list[Path]:
    """The places of a folder that ships, such as "checkpoints".

    These are the checkout, and `share/nsdr` of the environment, where an installed wheel puts the folder.
    """
    above = Path(__file__).resolve().parents
    # Not sys.prefix: pip also installs for a user, into a folder, and on Debian below /usr/local.
    installed = [folder / "share" / "nsdr" / name for folder in above]
    return [above[2] / name, *[folder for folder in installed if folder.is_dir()][:1]]


def find_config(file_or_name: str | Path, group: str) -> Path:
    """The YAML file of a configuration.

    Args:
        file_or_name: a file; or the name of a configuration that ships, which has neither a slash nor an ending.
        group: the subfolder of `configs` in which the name is looked for, such as "pipeline".

    Raises:
        DataError: no configuration of this name ships; the message lists those that do.
    """
    given = Path(file_or_name)
    if given.suffix or given.name != str(file_or_name):
        return given
    roots = reversed(shipped_folders("configs"))  # of two files of one name, that of the checkout counts
    files = {file.stem: file for root in roots for file in (root / group).glob("*.yaml")}
    if given.name not in files:
        known = ", ".join(sorted(files)) or "none"
        raise DataError(f"no configuration {given.name!r} ships; expected a YAML file, or one of {known}")
    return files[given.name]
