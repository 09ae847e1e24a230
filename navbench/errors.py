"""What may be wrong with a configuration, each as one short line."""

import re

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from navbench.description import DescriptionError

CONFIGURATION_ERRORS = (DescriptionError, HydraException, OmegaConfBaseException)


def one_line(error: BaseException) -> str:
    """Return an error as one short line that names the key and what is allowed."""
    text = str(error)
    unknown = re.match(r"Could not override '([^']+)'", text)
    if unknown:
        return f"{unknown[1]}: unknown key; `--cfg job` prints all that there are"
    cause = error.__cause__ or error.__context__
    if text.startswith("Error merging override") and cause is not None:
        text = f"{text.removeprefix('Error merging override ')}: {str(cause).splitlines()[0]}"
    text = text.replace(", set env var HYDRA_FULL_ERROR=1 to see chained exception", "")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    dropped = ("full_key:", "object_type=", "reference_type=", "Config search path", "Set the environment variable")
    return " ".join(line for line in lines if not line.startswith(dropped))
