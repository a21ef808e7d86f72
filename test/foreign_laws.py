"""Libraries of laws in C, compiled here."""

import subprocess

from parallel_robot import get_include

PD = """
#include "parallel_robot_law.h"
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

static int calls;

int32_t law_update(const law_input *in, law_output *out)
{
    calls = in->begins ? 1 : calls + 1;
    for (int i = 0; i < in->joints; i++) {
        double e = in->reference_position[i] - in->position[i];
        double e_dot = in->reference_velocity[i] - in->velocity[i];
        out->torque[i] = 1350.0 * e + 90.0 * e_dot;
    }
    if (calls > 20) { LATE }
    return 0;
}
AFTER
"""


def compiled(file, source, *flags, language='c'):
    """Compile a source to a library."""
    words = ['gcc', '-O1', '-shared', '-fPIC', '-I', get_include(), *flags, '-x', language, '-']
    subprocess.run([*words, '-o', str(file)], input=source, text=True, check=True)
    return file


def made(file, late='', after=''):
    """A PD law that does something after 20 samples of a run, with more after its function."""
    return compiled(file, PD.replace('LATE', late).replace('AFTER', after))
