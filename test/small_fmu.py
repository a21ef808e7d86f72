"""FMUs of FMI 2.0 and 3.0 that are small laws in C, compiled here."""

import subprocess
import zipfile
from xml.sax.saxutils import quoteattr

from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

# torque = 40 (reference - y) + velocity of each joint, y the position with a lag that begins there
SOURCE = """
#include <stddef.h>
#include <stdlib.h>
#define N 3
typedef struct { double x[4 * N]; double y[N]; int steps; } Law;  /* x: q, w, r, u */
static void begin(Law *l) { for (int k = 0; k < N; k++) l->y[k] = l->x[k]; }
static int step(Law *l)
{
    for (int k = 0; k < N; k++) {
        l->y[k] += 0.5 * (l->x[k] - l->y[k]);
        l->x[3 * N + k] = 40.0 * (l->x[2 * N + k] - l->y[k]) + l->x[N + k];
    }
    return ++l->steps > LAST;
}
static int set(Law *l, const unsigned r[], size_t n, const double v[])
{
    for (size_t k = 0; k < n; k++) l->x[r[k]] = v[k];
    return 0;
}
static int get(Law *l, const unsigned r[], size_t n, double v[])
{
    for (size_t k = 0; k < n; k++) v[k] = l->x[r[k]];
    return 0;
}
static int reset(Law *l) { *l = (Law){0}; return 0; }
#if FMI == 2
void *fmi2Instantiate(const char *a, int b, const char *c, const char *d, const void *e, int f,
                      int g) { return calloc(1, sizeof(Law)); }
void fmi2FreeInstance(void *l) { free(l); }
int fmi2SetupExperiment(void *l, int a, double b, double c, int d, double e) { return 0; }
int fmi2EnterInitializationMode(void *l) { return 0; }
int fmi2ExitInitializationMode(void *l) { begin(l); return 0; }
int fmi2Terminate(void *l) { return 0; }
int fmi2Reset(void *l) { return reset(l); }
int fmi2SetReal(void *l, const unsigned r[], size_t n, const double v[])
{ return set(l, r, n, v); }
int fmi2GetReal(void *l, const unsigned r[], size_t n, double v[])
{ return get(l, r, n, v); }
int fmi2DoStep(void *l, double t, double h, int x) { return step(l) ? 2 : 0; }
int fmi2GetBooleanStatus(void *l, int kind, int *value) { *value = kind == 3; return 0; }
#else
void *fmi3InstantiateCoSimulation(const char *a, const char *b, const char *c, _Bool d, _Bool e,
                                  _Bool f, _Bool g, const unsigned h[], size_t i, void *j,
                                  void *k, void *l) { return calloc(1, sizeof(Law)); }
void fmi3FreeInstance(void *l) { free(l); }
int fmi3EnterInitializationMode(void *l, _Bool a, double b, double c, _Bool d, double e)
{ return 0; }
int fmi3ExitInitializationMode(void *l) { begin(l); return 0; }
int fmi3Terminate(void *l) { return 0; }
int fmi3Reset(void *l) { return reset(l); }
int fmi3SetFloat64(void *l, const unsigned r[], size_t n, const double v[], size_t m)
{ return set(l, r, n, v); }
int fmi3GetFloat64(void *l, const unsigned r[], size_t n, double v[], size_t m)
{ return get(l, r, n, v); }
int fmi3DoStep(void *l, double t, double h, _Bool x, _Bool *event, _Bool *end, _Bool *early,
               double *last)
{ *event = *early = 0; *end = step(l); *last = t + h; return 0; }
#endif
"""
ROWS = {
    'position': 'input',
    'velocity': 'input',
    'reference.position': 'input',
    'torque': 'output',
}


def made(file, fmi=2, units=None, definitions='', last=1 << 30):
    """Make one.

    Args:
        file: Where.
        fmi: 2 or 3.
        units: Name of a row to the attributes of its variables.
        definitions: Units in XML.
        last: Steps, after which it asks for the end of the simulation.
    """
    listed = []
    for k, (name, role) in enumerate(ROWS.items()):
        for joint in range(3):
            common = f'name="{name}[{joint + 1}]" valueReference="{3 * k + joint}"'
            common += f' causality="{role}"'
            own = {} if role == 'output' else {'start': '0'}
            own |= (units or {}).get(name, {})
            words = ' '.join(f'{key}={quoteattr(value)}' for key, value in own.items())
            listed.append(
                f'<ScalarVariable {common}><Real {words}/></ScalarVariable>'
                if fmi == 2
                else f'<Float64 {common} {words}/>'
            )
    token = 'guid' if fmi == 2 else 'instantiationToken'
    text = (
        f'<fmiModelDescription fmiVersion="{fmi}.0" modelName="x" {token}="1">'
        '<CoSimulation modelIdentifier="x" canHandleVariableCommunicationStepSize="true"/>'
        f'<UnitDefinitions>{definitions}</UnitDefinitions>'
        f'<ModelVariables>{"".join(listed)}</ModelVariables><ModelStructure/>'
        '</fmiModelDescription>'
    )
    library = file.with_suffix('.so')
    words = ['gcc', '-O1', '-w', '-shared', '-fPIC', f'-DFMI={fmi}', f'-DLAST={last}', '-x', 'c']
    wanted = [each for each in dir({2: FMU2Slave, 3: FMU3Slave}[fmi]) if each.startswith('fmi')]
    source = SOURCE + ''.join(
        f'int {each}(void) {{ return 3; }}\n' for each in wanted if f'{each}(' not in SOURCE
    )
    subprocess.run([*words, '-', '-o', str(library)], input=source, text=True, check=True)
    place = 'binaries/linux64/x.so' if fmi == 2 else 'binaries/x86_64-linux/x.so'
    with zipfile.ZipFile(file, 'w') as archive:
        archive.writestr('modelDescription.xml', text)
        archive.write(library, place)
    library.unlink()
    return file
