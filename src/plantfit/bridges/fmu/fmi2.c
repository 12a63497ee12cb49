/* FMI 2.0 (https://fmi-standard.org): co-simulation of the plant, and model exchange, which modelDescription.xml offers where there is no
 * dead time. Value references count through parameters, inputs before the start, inputs, states, their derivatives and outputs.
 *
 * States follow Dormand and Prince's pair of orders 5 and 4 (J. Comput. Appl. Math. 6 (1980) 19) between the edges of the inputs. An input
 * keeps its value over a step, or goes on with the derivative that fmi2SetRealInputDerivatives gave for it. What a dead time still needs of
 * past inputs is remembered.
 */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

#define TOLERANCE 1e-9  /* of a step, of the size of a state; a smaller one that the importer asks for counts */
#define MOST_STEPS 1000000 /* between two communication points */

typedef void *fmi2Component, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(void *environment, fmi2String instance, fmi2Status status, fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *memory);
    void (*stepFinished)(void *environment, fmi2Status status);
    void *environment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged, valuesOfContinuousStatesChanged;
    fmi2Boolean nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

enum {
    FIRST_BEFORE = PARAMETERS,
    FIRST_INPUT = FIRST_BEFORE + INPUTS,
    FIRST_STATE = FIRST_INPUT + INPUTS,
    FIRST_RATE = FIRST_STATE + STATES,
    FIRST_OUTPUT = FIRST_RATE + STATES,
    VALUES = FIRST_OUTPUT + OUTPUTS,
    CHANNELS = INPUTS + DELAYS + 1
};

typedef struct {
    double p[PARAMETERS + 1], before[INPUTS + 1], input[INPUTS + 1], slope[INPUTS + 1], x[STATES];
    double now, step, tolerance;
    int begun; /* initialisation is over */
    int kept, room;
    double *t, *u; /* past inputs: kept times, and INPUTS values at each */
    char *name;
    fmi2CallbackFunctions calls;
} Plant;

static fmi2Status refused(const Plant *a, const char *form, ...)
{
    char text[400];
    va_list values;
    va_start(values, form);
    vsnprintf(text, sizeof text, form, values);
    va_end(values);
    if (a->calls.logger) a->calls.logger(a->calls.environment, a->name, fmi2Error, "logStatusError", text); /* no % in it */
    return fmi2Error;
}

static void begin(Plant *a)
{
    memcpy(a->p, MODEL(parameters), PARAMETERS*sizeof(double));
    memcpy(a->before, MODEL(before), INPUTS*sizeof(double));
    memcpy(a->input, first_inputs, INPUTS*sizeof(double));
    memcpy(a->x, MODEL(x0), STATES*sizeof(double));
    memset(a->slope, 0, sizeof a->slope);
    a->now = a->step = 0.0;
    a->tolerance = TOLERANCE;
    a->begun = a->kept = 0;
}

/* The inputs have these values from a time on. */
static int remember(Plant *a, double time, const double *values)
{
    const size_t size = INPUTS*sizeof(double);
    if (a->kept && a->t[a->kept - 1] == time && !memcmp(a->u + (size_t)(a->kept - 1)*INPUTS, values, size)) return 1;
    if (a->kept == a->room) {
        const int room = 2*a->room + 16;
        double *t = realloc(a->t, room*sizeof(double)), *u;
        if (t) a->t = t;
        u = realloc(a->u, room*size + 1);
        if (u) a->u = u;
        if (!t || !u) return 0;
        a->room = room;
    }
    a->t[a->kept] = time;
    memcpy(a->u + (size_t)a->kept*INPUTS, values, size);
    a->kept++;
    return 1;
}

/* Leave out what no dead time needs any more; in halves, so that each sample is moved once or twice. */
static void forget(Plant *a)
{
    double longest = 0.0;
    int j, first = 0;
    for (j = 0; j < DELAYS; j++) if (a->p[delay_places[j]] > longest) longest = a->p[delay_places[j]];
    while (first + 1 < a->kept && a->t[first + 1] <= a->now - longest) first++;
    if (2*first < a->kept) return;
    a->kept -= first;
    memmove(a->t, a->t + first, a->kept*sizeof(double));
    memmove(a->u, a->u + (size_t)first*INPUTS, (size_t)a->kept*INPUTS*sizeof(double));
}

static void seen(Plant *a, double *c)
{
    if (DELAYS) remember(a, a->now, a->input);
    channels(a->now, a->now, a->p, a->before, a->kept, a->t, a->u, c);
    memcpy(c, a->input, INPUTS*sizeof(double));
}

/* The states from one time to another between which no input jumps. 0: not finite, or too many steps. */
static int advance(Plant *a, double from, double to)
{
    static const double node[] = {0.0, 1.0/5, 3.0/10, 4.0/5, 8.0/9, 1.0, 1.0};
    static const double share[7][6] = {
        {0.0},
        {1.0/5},
        {3.0/40, 9.0/40},
        {44.0/45, -56.0/15, 32.0/9},
        {19372.0/6561, -25360.0/2187, 64448.0/6561, -212.0/729},
        {9017.0/3168, -355.0/33, 46732.0/5247, 49.0/176, -5103.0/18656},
        {35.0/384, 0.0, 500.0/1113, 125.0/192, -2187.0/6784, 11.0/84},
    };
    static const double off[] = {71.0/57600, 0.0, -71.0/16695, 71.0/1920, -17253.0/339200, 22.0/525, -1.0/40};
    const double middle = 0.5*(from + to), least = 1e-14*(fabs(from) + fabs(to));
    double at = from, k[7][STATES], z[STATES], c[CHANNELS];
    int i, j, s, taken;
    for (taken = 0; at < to; taken++) {
        const int last = !(a->step > 0.0 && at + a->step < to);
        const double h = last ? to - at : a->step;
        double error = 0.0, factor;
        if (taken == MOST_STEPS) return 0;
        for (s = 0; s < 7; s++) {
            for (i = 0; i < STATES; i++) {
                double sum = 0.0;
                for (j = 0; j < s; j++) sum += share[s][j]*k[j][i];
                z[i] = a->x[i] + h*sum;
            }
            channels(at + node[s]*h, middle, a->p, a->before, a->kept, a->t, a->u, c);
            rates(z, c, a->p, k[s]);
        }
        for (i = 0; i < STATES; i++) {
            double sum = 0.0, size = fmax(nominal[i], fmax(fabs(a->x[i]), fabs(z[i])));
            for (s = 0; s < 7; s++) sum += off[s]*k[s][i];
            error += pow(h*sum/(a->tolerance*size), 2.0)/STATES;
        }
        error = sqrt(error);
        factor = error > 0.0 ? 0.9*pow(error, -0.2) : 5.0;
        factor = factor < 0.2 ? 0.2 : factor > 5.0 ? 5.0 : factor;
        if (!(error <= 1.0)) { /* also where it is not a number */
            if (h <= least) return 0;
            a->step = h*(error > 1.0 ? factor : 0.1);
            continue;
        }
        memcpy(a->x, z, sizeof z);
        if (!last || h*factor > a->step) a->step = h*factor;
        at = last ? to : at + h;
    }
    return 1;
}

/* ---- instances ---------------------------------------------------------------------------------- */

EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }

EXPORTED fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    (void)c; (void)on; (void)count; (void)categories;
    return fmi2OK;
}

EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *calls, fmi2Boolean visible, fmi2Boolean logging)
{
    Plant *a = calloc(1, sizeof *a);
    (void)resources; (void)visible; (void)logging;
    if (!a) return NULL;
    if (calls) a->calls = *calls;
    a->name = malloc(name ? strlen(name) + 1 : 1);
    if (a->name) strcpy(a->name, name ? name : "");
    if (!a->name || !guid || strcmp(guid, GUID) || (type == fmi2ModelExchange && DELAYS)) {
        if (guid && strcmp(guid, GUID)) refused(a, "The guid of modelDescription.xml is not that of this binary; export the FMU again.");
        free(a->name);
        free(a);
        return NULL;
    }
    begin(a);
    return a;
}

EXPORTED void fmi2FreeInstance(fmi2Component c)
{
    Plant *a = c;
    if (!a) return;
    free(a->t);
    free(a->u);
    free(a->name);
    free(a);
}

EXPORTED fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start, fmi2Boolean stops,
                                        fmi2Real stop)
{
    Plant *a = c;
    (void)stops; (void)stop;
    if (tolerant && tolerance > 0.0 && tolerance < TOLERANCE) a->tolerance = tolerance;
    a->now = start;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status fmi2ExitInitializationMode(fmi2Component c) { ((Plant *)c)->begun = 1; return fmi2OK; }
EXPORTED fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status fmi2Reset(fmi2Component c) { begin(c); return fmi2OK; }

/* ---- values ------------------------------------------------------------------------------------- */

EXPORTED fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference which[], size_t count, fmi2Real value[])
{
    Plant *a = c;
    double now[CHANNELS], dx[STATES], y[OUTPUTS + 1];
    size_t k;
    int known = 0;
    for (k = 0; k < count; k++) {
        const unsigned v = which[k];
        if (v >= VALUES) return refused(a, "There is no variable with the value reference %u.", v);
        if (v >= FIRST_RATE && !known) {
            seen(a, now);
            rates(a->x, now, a->p, dx);
            outputs(a->x, now, a->p, y);
            known = 1;
        }
        value[k] = v < FIRST_BEFORE ? a->p[v] : v < FIRST_INPUT ? a->before[v - FIRST_BEFORE] :
                   v < FIRST_STATE ? a->input[v - FIRST_INPUT] : v < FIRST_RATE ? a->x[v - FIRST_STATE] :
                   v < FIRST_OUTPUT ? dx[v - FIRST_RATE] : y[v - FIRST_OUTPUT];
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference which[], size_t count, const fmi2Real value[])
{
    Plant *a = c;
    size_t k;
    int j;
    for (k = 0; k < count; k++) {
        const unsigned v = which[k];
        int fixed = (v >= FIRST_BEFORE && v < FIRST_INPUT) || (v >= FIRST_STATE && v < FIRST_RATE);
        if (v >= FIRST_RATE) return refused(a, "The variable with the value reference %u cannot be set.", v);
        if (!isfinite(value[k])) return refused(a, "The variable with the value reference %u cannot be %g.", v, value[k]);
        for (j = 0; j < DELAYS; j++) {
            if ((int)v != delay_places[j]) continue;
            fixed = 1;
            if (value[k] < 0.0) return refused(a, "A dead time of %g s is negative.", value[k]);
        }
        if (fixed && a->begun) return refused(a, "The variable with the value reference %u is set before the simulation begins only.", v);
        if (v < FIRST_BEFORE) a->p[v] = value[k];
        else if (v < FIRST_INPUT) a->before[v - FIRST_BEFORE] = value[k];
        else if (v < FIRST_STATE) a->input[v - FIRST_INPUT] = value[k];
        else a->x[v - FIRST_STATE] = value[k];
    }
    return fmi2OK;
}

#define NONE(what, type, given) \
    EXPORTED fmi2Status what(fmi2Component c, const fmi2ValueReference which[], size_t count, given type value[]) \
    { \
        (void)which; (void)value; \
        return count ? refused(c, "All variables of this plant are real numbers.") : fmi2OK; \
    }
#define NOTHING
NONE(fmi2GetInteger, fmi2Integer, NOTHING)
NONE(fmi2GetBoolean, fmi2Boolean, NOTHING)
NONE(fmi2GetString, fmi2String, NOTHING)
NONE(fmi2SetInteger, fmi2Integer, const)
NONE(fmi2SetBoolean, fmi2Boolean, const)
NONE(fmi2SetString, fmi2String, const)

EXPORTED fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Plant *held = state ? *state : NULL;
    (void)c;
    if (held) {
        free(held->t);
        free(held->u);
        free(held);
        *state = NULL;
    }
    return fmi2OK;
}

/* All that one instance knows, to another; the name and the calls are each one's own. */
static int copied(Plant *to, const Plant *from)
{
    Plant own = *to;
    const int room = from->kept;
    double *t = realloc(own.t, room*sizeof(double) + 1), *u;
    if (t) own.t = to->t = t;
    u = realloc(own.u, (size_t)room*INPUTS*sizeof(double) + 1);
    if (u) own.u = to->u = u;
    if (!t || !u) return 0;
    *to = *from;
    to->t = t;
    to->u = u;
    to->room = room;
    to->name = own.name;
    to->calls = own.calls;
    if (room) memcpy(t, from->t, room*sizeof(double));
    if (room) memcpy(u, from->u, (size_t)room*INPUTS*sizeof(double));
    return 1;
}

EXPORTED fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Plant *held = *state ? *state : calloc(1, sizeof *held);
    *state = held;
    return held && copied(held, c) ? fmi2OK : refused(c, "There is no memory for the state of this plant.");
}

EXPORTED fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return state && copied(c, state) ? fmi2OK : refused(c, "There is no state of this plant to go back to.");
}

EXPORTED fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)state; (void)size;
    return refused(c, "States of this plant cannot be written as bytes.");
}

EXPORTED fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, char bytes[], size_t size)
{
    (void)bytes;
    return fmi2SerializedFMUstateSize(c, state, &size);
}

EXPORTED fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const char bytes[], size_t size, fmi2FMUstate *state)
{
    (void)bytes;
    return fmi2SerializedFMUstateSize(c, state, &size);
}

EXPORTED fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                 const fmi2ValueReference known[], size_t knowns, const fmi2Real moved[], fmi2Real slope[])
{
    (void)unknown; (void)unknowns; (void)known; (void)knowns; (void)moved; (void)slope;
    return refused(c, "This plant gives no directional derivatives.");
}

/* ---- co-simulation ------------------------------------------------------------------------------ */

EXPORTED fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference which[], size_t count, const fmi2Integer order[],
                                                const fmi2Real value[])
{
    Plant *a = c;
    size_t k;
    for (k = 0; k < count; k++) {
        if (which[k] < FIRST_INPUT || which[k] >= FIRST_STATE || order[k] != 1)
            return refused(a, "Only first derivatives of inputs can be set, not order %d of value reference %u.", order[k], which[k]);
        a->slope[which[k] - FIRST_INPUT] = value[k];
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference which[], size_t count, const fmi2Integer order[],
                                                 fmi2Real value[])
{
    (void)which; (void)order; (void)value;
    return count ? refused(c, "This plant gives no derivatives of outputs.") : fmi2OK;
}

EXPORTED fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real step, fmi2Boolean final)
{
    Plant *a = c;
    const double end = point + step;
    double after[INPUTS + 1], edge;
    int j;
    (void)final;
    if (!(step > 0.0)) return refused(a, "A step of %g s cannot be taken.", step);
    if (!(fabs(point - a->now) <= 1e-6*step)) return refused(a, "The step begins at %g s, and the plant stands at %g s.", point, a->now);
    for (j = 0; j < INPUTS; j++) after[j] = a->input[j] + step*a->slope[j];
    a->now = point;
    if (!remember(a, point, a->input) || !remember(a, end, after)) return refused(a, "There is no memory for past inputs.");
    while (a->now < end) {
        edge = next_edge(a->now, end, a->p, a->kept, a->t);
        if (!advance(a, a->now, edge)) {
            return refused(a, "The plant cannot be simulated beyond %g s: its states are not finite any more, or change too fast for an "
                              "explicit method.", a->now);
        }
        a->now = edge;
    }
    memcpy(a->input, after, INPUTS*sizeof(double));
    memset(a->slope, 0, sizeof a->slope);
    forget(a);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2CancelStep(fmi2Component c) { (void)c; return fmi2Error; }

#define NO_STATUS(what, type) \
    EXPORTED fmi2Status what(fmi2Component c, fmi2StatusKind kind, type *value) \
    { \
        (void)c; (void)kind; (void)value; \
        return fmi2Discard; \
    }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)

EXPORTED fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Plant *)c)->now;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)c;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = 0;
    return fmi2OK;
}

/* ---- model exchange ----------------------------------------------------------------------------- */

EXPORTED fmi2Status fmi2EnterEventMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) { ((Plant *)c)->now = time; return fmi2OK; }

EXPORTED fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event, fmi2Boolean *terminate)
{
    (void)c; (void)final;
    *event = *terminate = 0;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t count)
{
    if (count != STATES) return refused(c, "This plant has %d states, not %u.", STATES, (unsigned)count);
    memcpy(((Plant *)c)->x, x, STATES*sizeof(double));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t count)
{
    if (count != STATES) return refused(c, "This plant has %d states, not %u.", STATES, (unsigned)count);
    memcpy(x, ((Plant *)c)->x, STATES*sizeof(double));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t count)
{
    double now[CHANNELS];
    if (count != STATES) return refused(c, "This plant has %d states, not %u.", STATES, (unsigned)count);
    seen(c, now);
    rates(((Plant *)c)->x, now, ((Plant *)c)->p, dx);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real size[], size_t count)
{
    if (count != STATES) return refused(c, "This plant has %d states, not %u.", STATES, (unsigned)count);
    memcpy(size, nominal, STATES*sizeof(double));
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real value[], size_t count)
{
    (void)value;
    return count ? refused(c, "This plant has no events.") : fmi2OK;
}
