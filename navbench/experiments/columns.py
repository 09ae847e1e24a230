"""What each column of each stored table holds; the pages of ``docs/`` print it, and a test finds no other column."""

from collections.abc import Mapping

Columns = Mapping[str, str]

RUN: Columns = {
    "run_id": "digits of the cell: over its whole configuration and the seed; the manifest has both",
    "episode": "the index of the episode, from 0",
    "robot_index": "which robot of the world, from 0",
}
TUNING: Columns = {
    "tuning_id": "digits of the tuning: over its whole configuration, its budget and its seed",
    "name": "what the tuning is called",
    "tuner": "the name of the tuner",
    "seed": "of the tuner and of the evaluations",
}
COST: Columns = {
    "cost": "of the objective, over all robots, worlds and episodes",
    "reached": "how many robots reached their goals",
    "robots": "of how many",
}
TABLES: Mapping[str, Columns] = {  # by the kind of its parts, in the order of ``parts.KINDS``
    "episodes": {
        **RUN,
        "controller": "the names of the cell's parts in the configuration",
        "world": "",
        "robot": "",
        "sensors": "",
        "simulator": "",
        "config_hash": "digits over everything that decides an episode but seed and index",
        "seed": "of every random stream",
        "outcome": "reached, collided, timed_out, controller_error, or no_layout where none could be drawn",
        "reason": "what it hit, what the controller did, or which metric failed; empty where the outcome says all",
        "traceback": "of what a controller raised; empty where it raised nothing",
        "hit": "the kind of what a robot that collided hit: box, cell, disc, mover, polygon, robot or wall; else empty",
        "hit_index": "which one of these in its world; -1 without",
        "layout_id": "digits of the layout that was driven, which stands in `layouts`; empty where none was",
    },
    "trajectories": {
        **RUN,
        "t_s": "the time at the beginning of a control period [s]; the last row of an episode is its end",
        "x_m": "where the robot's centre is [m]",
        "y_m": "",
        "heading_rad": "where the robot looks, counter-clockwise from x, in (-π, π] [rad]",
        "v_mps": "the mean speed in this period [m/s]; in the last row that of the one before",
        "w_radps": "the mean turning rate in this period, positive to the left [rad/s]; likewise",
        "ranges_m": "with `record=ranges`: a list of what each range sensor read at that time [m], in the order of the "
        "suite and with its errors, as the controller met it; none in the last row",
    },
    "latency": {
        **RUN,
        "acts": "how often the controller acted",
        "act_median_s": "the median time of an act on the machine's clock [s]",
        "act_p99_s": "the time that 99 % of the acts did not exceed [s]",
        "act_max_s": "the longest time [s]",
    },
    "layouts": {
        "layout_id": "digits of the layout",
        "layout": "the layout as JSON: bounds, obstacles, movers, starts and goals",
    },
    "evaluations": {**TUNING, "evaluation": "the index of the evaluation, in the order of the search", **COST},
    "checks": {
        **TUNING,
        "kind": "searched: over the episodes of the search; verified: over the same in another simulator; fresh: over "
        "as many that the search has not seen",
        "simulator": "in which",
        "first_episode": "the index of the first episode",
        "episodes": "how many, in each world",
        **COST,
    },
}
