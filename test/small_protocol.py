"""A small benchmark: protocol 1 for one robot, in half a second, at one speed."""

import yaml

from parallel_robot_model.configuration import config


def written(path, robot, trials, ages=('told', 'hidden')):
    """Write it into a file, and return its path."""
    whole = config.directory() / 'benchmarks' / 'protocol_1.yaml'
    content = yaml.safe_load(whole.read_text())
    content |= {'duration': 0.5, 'scrambles': 2, 'speeds': [3.0]}
    content['ages'] = {age: content['ages'][age] for age in ages}
    content['search'] |= {'trials': trials, 'runs': 1}
    content['robots'] = {robot: content['robots'][robot]}
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path
