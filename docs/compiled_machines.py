"""Write the numbers of the shipped machines beside them, as MuJoCo compiles them."""

from parallel_robot_model.configuration import config_files, robot_file
from parallel_robot_model.robots.described.robot import compiled_of


def main():
    for name in config_files.builtin_machines():
        path = config_files.machine_path(name)
        numbers = compiled_of(robot_file.text_of(path))
        path.with_suffix('.json').write_text(f'{numbers}\n', encoding='utf-8')


if __name__ == '__main__':
    main()
