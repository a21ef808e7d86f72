"""The laws by name. A new law is one module and one line here, and one file in config/laws."""

from parallel_robot_control import s_fotsmc
from parallel_robot_control.contract import Law

LAWS: dict[str, Law] = {
    's_fotsmc': s_fotsmc,  # type: ignore[dict-item]
}
