/* A tank as an FMU of FMI 2.0 (-DFMI=2) or 3.0 (-DFMI=3), for tests of the driver `fmu`.
 *
 * time_constant * d(level)/dt + level = gain * inflow, solved exactly for an inflow that is constant during a step.
 * `count` chooses what the model does wrong, `fault` the status of the next step. The headers are FMI's own. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { TIME, INFLOW, TIME_CONSTANT, GAIN, LEVEL, COUNT, DOUBLED, ENABLE, ENABLED, MODE, MODE_USED, FAULT, ODD, STEPS,
       LABEL, SMALL, SMALL_OUT, BIG, BIG_OUT, SINGLE, SINGLE_OUT, WIDE, WIDE_OUT, WORD, WORD_OUT, BROKEN, TEXT_OUT,
       DATA_OUT, ROWS_OUT, BYTE, BYTE_OUT, DWORD, DWORD_OUT, ROWS };

typedef struct {
    void *environment, *log;
    char name[64], label[64];
    double time, inflow, time_constant, gain, level;
    int64_t count, enable, mode, fault, steps, small, big, wide, word, byte, dword, ended;
    double single, rows[6];
} Tank;

static int say(Tank *m, int status, const char *text, double number);

static int finite_double(int vr, const Tank *m, double *value) {
    double odd = m->count == 13 ? NAN : m->count == 14 ? INFINITY : m->count == 15 ? 1e300 : 0.25;
    switch (vr) {
    case TIME: *value = m->time; return 0;
    case INFLOW: *value = m->inflow; return 0;
    case TIME_CONSTANT: *value = m->time_constant; return 0;
    case GAIN: *value = m->gain; return 0;
    case LEVEL: *value = m->level; return 0;
    case ODD: *value = odd; return m->count == 16 ? 2 : m->count == 17 ? 3 : 0;
    case BROKEN: return 2;
    case SINGLE: case SINGLE_OUT: *value = m->single; return 0;
    default: return 3;
    }
}

static int set_double(int vr, Tank *m, double value) {
    switch (vr) {
    case INFLOW:
        if (value > 1e6) return say(m, 2, "an inflow of %g is too large", value);
        m->inflow = value;
        return 0;
    case TIME_CONSTANT: m->time_constant = value; return 0;
    case GAIN: m->gain = value; return 0;
    case LEVEL: m->level = value; return 0;
    case SINGLE: m->single = value; return 0;
    case BROKEN: return say(m, 2, "%g is refused", value);
    default: return 3;
    }
}

static int64_t *integer(int vr, Tank *m) {
    switch (vr) {
    case COUNT: return &m->count;
    case ENABLE: case ENABLED: return &m->enable;
    case MODE: case MODE_USED: return &m->mode;
    case FAULT: return &m->fault;
    case STEPS: return &m->steps;
    case SMALL: case SMALL_OUT: return &m->small;
    case BIG: case BIG_OUT: return &m->big;
    case WIDE: case WIDE_OUT: return &m->wide;
    case WORD: case WORD_OUT: return &m->word;
    case BYTE: case BYTE_OUT: return &m->byte;
    case DWORD: case DWORD_OUT: return &m->dword;
    default: return NULL;
    }
}

static int step(Tank *m, double start, double size) {
    int fault = (int)m->fault;
    m->fault = 0;
    m->ended = fault == 9; /* the model asks for the end of the simulation, after half of the step in FMI 2.0 */
    if (m->ended && FMI == 2) return m->time = start + size / 2, say(m, 2, "the tank is full, %g", m->level);
    if (m->ended) fault = 0;
    if (fault) return say(m, fault, "the pump ran dry at %.1f s", start);
    if (fabs(start - m->time) > 1e-9) return say(m, 3, "the step does not begin at %g s", m->time);
    double end = m->gain * (m->enable ? m->inflow : 0.0);
    m->level = end + (m->level - end) * exp(-size / m->time_constant);
    m->time = start + size;
    m->steps++;
    return 0;
}

static Tank *make(const char *name, void *environment, void *log) {
    Tank *m = calloc(1, sizeof *m);
    strncpy(m->name, name, sizeof m->name - 1);
    m->environment = environment;
    m->log = log;
    m->time_constant = 2.0;
    m->gain = 1.0;
    m->mode = 1;
    return m;
}

#define STUB(name) int name(void) { return 3; }
/* One get and one set function of an integer type; N stands for FMI 3.0's number of values. */
#define INTEGERS(prefix, suffix, type, N)                                                                             \
    int prefix##Get##suffix(void *c, const unsigned vr[], size_t n, type value[] N) {                                 \
        for (size_t i = 0; i < n; i++) {                                                                              \
            int64_t *v = integer(vr[i], c);                                                                           \
            if (vr[i] == DOUBLED) value[i] = (type)(2 * ((Tank *)c)->count);                                          \
            else if (v) value[i] = (type)*v;                                                                          \
            else return 3;                                                                                            \
        }                                                                                                             \
        return 0;                                                                                                     \
    }                                                                                                                 \
    int prefix##Set##suffix(void *c, const unsigned vr[], size_t n, const type value[] N) {                           \
        for (size_t i = 0; i < n; i++) {                                                                              \
            int64_t *v = integer(vr[i], c);                                                                           \
            if (!v) return 3;                                                                                         \
            *v = (int64_t)value[i];                                                                                   \
        }                                                                                                             \
        return 0;                                                                                                     \
    }
#define DOUBLES(prefix, suffix, type, N)                                                                              \
    int prefix##Get##suffix(void *c, const unsigned vr[], size_t n, type value[] N) {                                 \
        size_t at = 0;                                                                                                \
        for (size_t i = 0; i < n; i++) {                                                                              \
            Tank *m = c;                                                                                              \
            double v = 0;                                                                                             \
            int status = 0;                                                                                           \
            if (vr[i] == ROWS || vr[i] == ROWS_OUT) { /* arrays of two rows of three */                               \
                for (int k = 0; k < 6; k++) value[at++] = (type)(m->rows[k] + (vr[i] == ROWS ? 0 : k + 0.5));         \
                continue;                                                                                             \
            }                                                                                                         \
            status = finite_double(vr[i], c, &v);                                                                     \
            value[at++] = (type)v;                                                                                    \
            if (status) return status;                                                                                \
        }                                                                                                             \
        return 0;                                                                                                     \
    }                                                                                                                 \
    int prefix##Set##suffix(void *c, const unsigned vr[], size_t n, const type value[] N) {                           \
        size_t at = 0;                                                                                                \
        for (size_t i = 0; i < n; i++) {                                                                              \
            if (vr[i] == ROWS) {                                                                                      \
                for (int k = 0; k < 6; k++) ((Tank *)c)->rows[k] = value[at++];                                       \
                continue;                                                                                             \
            }                                                                                                         \
            int status = set_double(vr[i], c, value[at++]);                                                           \
            if (status) return status;                                                                                \
        }                                                                                                             \
        return 0;                                                                                                     \
    }
#define STRINGS(prefix, N)                                                                                            \
    int prefix##GetString(void *c, const unsigned vr[], size_t n, const char *value[] N) {                            \
        for (size_t i = 0; i < n; i++) value[i] = vr[i] == TEXT_OUT ? "h\xc3\xb6he \xff" : ((Tank *)c)->label;     \
        return vr ? 0 : 3;                                                                                            \
    }                                                                                                                 \
    int prefix##SetString(void *c, const unsigned vr[], size_t n, const char *const value[] N) {                      \
        for (size_t i = 0; i < n; i++) strncpy(((Tank *)c)->label, value[i], 63);                                     \
        return vr ? 0 : 3;                                                                                            \
    }

#if FMI == 2
#include "fmi2FunctionTypes.h"

static int say(Tank *m, int status, const char *text, double number) {
    const fmi2CallbackFunctions *callbacks = m->log;
    callbacks->logger(callbacks->componentEnvironment, m->name, status, "logStatusError", text, number);
    return status;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    Tank *m = make(name, callbacks->componentEnvironment, (void *)callbacks);
    if (type == fmi2CoSimulation && !strcmp(guid, "{tank}")) return m;
    say(m, 3, "the guid is another one, %g", 0.0);
    free(m);
    return NULL;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean sd,
                               fmi2Real s) {
    (void)td, (void)t, (void)sd, (void)s;
    ((Tank *)c)->time = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return ((Tank *)c)->time_constant > 0 ? 0 : say(c, 3, "a time constant of %g s", ((Tank *)c)->time_constant);
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Reset(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)categories;
    return n ? fmi2OK : fmi2Error;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real start, fmi2Real size, fmi2Boolean no_set) {
    (void)no_set;
    return step(c, start, size);
}
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
#define NONE
DOUBLES(fmi2, Real, double, NONE)
INTEGERS(fmi2, Integer, int, NONE)
INTEGERS(fmi2, Boolean, int, NONE)
STRINGS(fmi2, NONE)
STUB(fmi2GetFMUstate) STUB(fmi2SetFMUstate) STUB(fmi2FreeFMUstate) STUB(fmi2SerializedFMUstateSize)
STUB(fmi2SerializeFMUstate) STUB(fmi2DeSerializeFMUstate) STUB(fmi2GetDirectionalDerivative)
STUB(fmi2SetRealInputDerivatives) STUB(fmi2GetRealOutputDerivatives) STUB(fmi2CancelStep) STUB(fmi2GetStatus)
STUB(fmi2GetIntegerStatus) STUB(fmi2GetStringStatus)
fmi2Status fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value) {
    *value = kind == fmi2Terminated && ((Tank *)c)->ended;
    return fmi2OK;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Tank *)c)->time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Error;
}
#else
#include <stdio.h>
#include "fmi3FunctionTypes.h"

static int say(Tank *m, int status, const char *text, double number) {
    char line[200];
    snprintf(line, sizeof line, text, number);
    ((fmi3LogMessageCallback)m->log)(m->environment, status, "logStatusError", line);
    return status;
}
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)resources, (void)visible, (void)logging, (void)early, (void)intermediate, (void)n, (void)update;
    Tank *m = make(name, environment, (void *)log);
    if (!events && !strcmp(token, "{tank}")) return m;
    say(m, 3, "the token is another one, %g", 0.0);
    free(m);
    return NULL;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean td, fmi3Float64 t, fmi3Float64 start, fmi3Boolean sd,
                                       fmi3Float64 s) {
    (void)td, (void)t, (void)sd, (void)s;
    ((Tank *)c)->time = start;
    return ((Tank *)c)->time_constant > 0 ? 0 : say(c, 3, "a time constant of %g s", ((Tank *)c)->time_constant);
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)c, (void)on, (void)categories;
    return n ? fmi3OK : fmi3Error;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 start, fmi3Float64 size, fmi3Boolean no_set, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    (void)no_set;
    Tank *m = c;
    int status = step(m, start, size);
    *event = *early = 0;
    *terminate = m->ended != 0;
    *last = m->time;
    return status;
}
const char *fmi3GetVersion(void) { return "3.0"; }
#define N , size_t nv __attribute__((unused))
DOUBLES(fmi3, Float64, double, N)
DOUBLES(fmi3, Float32, float, N)
INTEGERS(fmi3, Int8, int8_t, N)
INTEGERS(fmi3, Int16, int16_t, N)
INTEGERS(fmi3, UInt16, uint16_t, N)
INTEGERS(fmi3, Int32, int32_t, N)
INTEGERS(fmi3, Int64, int64_t, N)
INTEGERS(fmi3, UInt64, uint64_t, N)
INTEGERS(fmi3, Boolean, _Bool, N)
STRINGS(fmi3, N)
INTEGERS(fmi3, UInt8, uint8_t, N)
INTEGERS(fmi3, UInt32, uint32_t, N)
fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[],
                         size_t nv) {
    static const fmi3Byte data[] = {0xde, 0xad, 0xbe, 0xef};
    (void)c, (void)vr, (void)nv;
    for (size_t i = 0; i < n; i++) sizes[i] = sizeof data, values[i] = data;
    return fmi3OK;
}
STUB(fmi3SetBinary)
STUB(fmi3GetClock) STUB(fmi3SetClock) STUB(fmi3InstantiateModelExchange) STUB(fmi3InstantiateScheduledExecution)
STUB(fmi3EnterEventMode) STUB(fmi3ActivateModelPartition) STUB(fmi3GetNumberOfVariableDependencies)
STUB(fmi3GetVariableDependencies) STUB(fmi3GetFMUState) STUB(fmi3SetFMUState) STUB(fmi3FreeFMUState)
STUB(fmi3SerializedFMUStateSize) STUB(fmi3SerializeFMUState) STUB(fmi3DeserializeFMUState)
STUB(fmi3GetDirectionalDerivative) STUB(fmi3GetAdjointDerivative) STUB(fmi3EnterConfigurationMode)
STUB(fmi3ExitConfigurationMode) STUB(fmi3GetIntervalDecimal) STUB(fmi3GetIntervalFraction) STUB(fmi3GetShiftDecimal)
STUB(fmi3GetShiftFraction) STUB(fmi3SetIntervalDecimal) STUB(fmi3SetIntervalFraction) STUB(fmi3SetShiftDecimal)
STUB(fmi3SetShiftFraction) STUB(fmi3EvaluateDiscreteStates) STUB(fmi3UpdateDiscreteStates) STUB(fmi3EnterStepMode)
STUB(fmi3GetOutputDerivatives) STUB(fmi3CompletedIntegratorStep) STUB(fmi3EnterContinuousTimeMode)
STUB(fmi3GetContinuousStateDerivatives) STUB(fmi3GetContinuousStates) STUB(fmi3GetEventIndicators)
STUB(fmi3GetNominalsOfContinuousStates) STUB(fmi3GetNumberOfContinuousStates) STUB(fmi3GetNumberOfEventIndicators)
STUB(fmi3SetContinuousStates) STUB(fmi3SetTime)
#endif
