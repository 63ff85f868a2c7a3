/* A tank that fills and drains, as an FMU for co-simulation of FMI 2.0 and of FMI 3.0.
 *
 * level' = (inflow - drain * level) / area, by one step of Euler's method a communication step.
 * In FMI 3.0 it has arrays too: valves, which let water in, and others that show what was set.
 */
#include <stdbool.h>
#include <stdlib.h>

#ifdef TANK_FMI_3
#include "fmi3Functions.h"
#define OK fmi3OK
#define ERROR fmi3Error
typedef fmi3Status Status;
typedef fmi3ValueReference Reference;
#else
#include "fmi2Functions.h"
#define OK fmi2OK
#define ERROR fmi2Error
typedef fmi2Status Status;
typedef fmi2ValueReference Reference;
#endif

enum { INFLOW, LEVEL, AREA, DRAIN, DOUBLED, FAILS_AT, ENDS_AT, REALS,
       COUNT = 16, GEAR, FULL = 32, HALF = 48,
       ROW = 80, VALVES, GRID, SHOWN, TURNS, OPEN };

typedef struct {
    double real[REALS];
    double valves[2], grid[6];
    int count, gear, turns[3];
    bool ended, logging, open[2];
    double time;
    void *environment;
    void *logger;
} Tank;

static Tank *make(void *logger, void *environment, bool logging)
{
    Tank *tank = calloc(1, sizeof *tank);
    tank->real[LEVEL] = tank->real[AREA] = 1.0;
    tank->real[DRAIN] = 0.5;
    tank->real[FAILS_AT] = tank->real[ENDS_AT] = 1e9;
    tank->gear = 1;
    tank->logger = logger;
    tank->environment = environment;
    tank->logging = logging;
    tank->grid[0] = 7;
    tank->turns[0] = tank->turns[1] = tank->turns[2] = 4;
    tank->open[1] = true;
    return tank;
}

static double real(Tank *tank, Reference r)
{
    return r == DOUBLED ? 2 * tank->real[INFLOW] : tank->real[r];
}

static int integer(Tank *tank, Reference r)
{
    return r == COUNT ? tank->count : r == GEAR ? tank->gear : tank->real[LEVEL] > 2;
}

/* A tank that fails at once does not say why. */
static bool mute(Tank *tank) { return tank->real[FAILS_AT] < 0; }

/* Whether the step succeeds; a tank that ends leaves the step undone. */
static bool flow(Tank *tank, double now, double step)
{
    double *v = tank->real;
    if (now + step > v[FAILS_AT]) return false;
    tank->ended = now + step > v[ENDS_AT];
    if (tank->ended) return true;
    double in = tank->gear * v[INFLOW] + tank->valves[0] + 10 * tank->valves[1];
    v[LEVEL] += step * (in - v[DRAIN] * v[LEVEL]) / v[AREA];
    tank->count++;
    tank->time = now + step;
    return true;
}

#ifdef TANK_FMI_3

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference wanted[],
    size_t n, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    return make((void *)log, environment, logging);
}

void fmi3FreeInstance(fmi3Instance tank) { free(tank); }

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance tank, fmi3Boolean tolerant, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean stops, fmi3Float64 stop)
{
    return OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance tank) { return OK; }
fmi3Status fmi3Terminate(fmi3Instance tank) { return OK; }

fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 now, fmi3Float64 step, fmi3Boolean keep, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Tank *tank = instance;
    fmi3LogMessageCallback log = (fmi3LogMessageCallback)tank->logger;
    bool flows = flow(tank, now, step);
    if (tank->logging) {
        log(tank->environment, fmi3OK, "logAll", "a step was asked for");
        if (!flows && !mute(tank))
            log(tank->environment, fmi3Error, "logStatusError", "the tank has burst");
        log(tank->environment, fmi3OK, "logAll", "the step is over");
    }
    if (!flows) return ERROR;
    *event = *early = false;
    *terminate = tank->ended;
    *last = tank->time;
    return OK;
}

/* How many numbers a variable holds. */
static size_t size(Reference r)
{
    return r == ROW || r == TURNS ? 3 : r == VALVES || r == OPEN ? 2
         : r == GRID || r == SHOWN ? 6 : 1;
}

static double number(Tank *tank, Reference r, size_t i)
{
    switch (r) {
    case ROW: return (double)(i + 1) * tank->real[LEVEL];
    case VALVES: return tank->valves[i];
    case GRID: case SHOWN: return tank->grid[i];
    case TURNS: return tank->turns[i];
    case OPEN: return tank->open[i];
    case HALF: return tank->real[LEVEL] / 2;
    default: return r < REALS ? real(tank, r) : integer(tank, r);
    }
}

/* Arrays are read and written whole: any other number of values is an error. */
#define GET(TYPE)                                                                                  \
    fmi3Status fmi3Get##TYPE(                                                                      \
        fmi3Instance tank, const Reference r[], size_t n, fmi3##TYPE values[], size_t m)           \
    {                                                                                              \
        size_t at = 0;                                                                             \
        for (size_t i = 0; i < n; i++)                                                             \
            for (size_t k = 0; k < size(r[i]); k++, at++)                                          \
                if (at < m) values[at] = (fmi3##TYPE)number(tank, r[i], k);                        \
        return at == m ? OK : ERROR;                                                               \
    }
GET(Float64)
GET(Float32)
GET(Int32)
GET(UInt8)
GET(Boolean)

#define SET(TYPE, PLACE)                                                                           \
    fmi3Status fmi3Set##TYPE(                                                                      \
        fmi3Instance instance, const Reference r[], size_t n, const fmi3##TYPE values[], size_t m) \
    {                                                                                              \
        Tank *tank = instance;                                                                     \
        size_t at = 0;                                                                             \
        for (size_t i = 0; i < n; at += size(r[i]), i++)                                           \
            if (at + size(r[i]) <= m)                                                              \
                for (size_t k = 0; k < size(r[i]); k++) (PLACE)[k] = values[at + k];               \
        return at == m ? OK : ERROR;                                                               \
    }
SET(Float64, r[i] == VALVES ? tank->valves : r[i] == GRID ? tank->grid : &tank->real[r[i]])
SET(Int32, r[i] == TURNS ? tank->turns : &tank->gear)
SET(Boolean, tank->open)

#else

fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    return make((void *)callbacks->logger, callbacks->componentEnvironment, logging);
}

void fmi2FreeInstance(fmi2Component tank) { free(tank); }

fmi2Status fmi2SetupExperiment(
    fmi2Component tank, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start, fmi2Boolean stops,
    fmi2Real stop)
{
    return OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component tank) { return OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component tank) { return OK; }
fmi2Status fmi2Terminate(fmi2Component tank) { return OK; }

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real now, fmi2Real step, fmi2Boolean keep)
{
    Tank *tank = instance;
    fmi2CallbackLogger log = (fmi2CallbackLogger)tank->logger;
    bool flows = flow(tank, now, step);
    if (tank->logging) {
        log(tank->environment, "tank", fmi2OK, "logAll", "a step was asked for");
        if (!flows && !mute(tank))
            log(tank->environment, "tank", fmi2Error, "logStatusError", "the %s has burst", "tank");
        log(tank->environment, "tank", fmi2OK, "logAll", "the step is over");
    }
    if (!flows) return ERROR;
    return tank->ended ? fmi2Discard : OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component tank, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = ((Tank *)tank)->ended;
    return OK;
}

#define GET(TYPE, VALUE)                                                                           \
    fmi2Status fmi2Get##TYPE(                                                                      \
        fmi2Component tank, const Reference r[], size_t n, fmi2##TYPE values[])                    \
    {                                                                                              \
        for (size_t i = 0; i < n; i++) values[i] = VALUE;                                          \
        return OK;                                                                                 \
    }
GET(Real, real(tank, r[i]))
GET(Integer, integer(tank, r[i]))
GET(Boolean, integer(tank, r[i]))

fmi2Status fmi2SetReal(
    fmi2Component tank, const Reference r[], size_t n, const fmi2Real values[])
{
    for (size_t i = 0; i < n; i++) ((Tank *)tank)->real[r[i]] = values[i];
    return OK;
}

fmi2Status fmi2SetInteger(
    fmi2Component tank, const Reference r[], size_t n, const fmi2Integer values[])
{
    for (size_t i = 0; i < n; i++) ((Tank *)tank)->gear = values[i];
    return OK;
}

#endif
