/* A plugin that breaks one rule of the header, chosen by -D. Without any it is a good one: robot `mock`, model `mock`. */
#include <math.h>
#include <unistd.h>
#include <wheelwright_plugin.h>

static const ww_channel INPUTS[] = {{"u", "1"}};
#ifdef TWIN_CHANNELS
static const ww_channel OUTPUTS[] = {{"x", "1"}, {"x", "1"}};
#else
static const ww_channel OUTPUTS[] = {{"x", "1"}, {"z", "1"}};
#endif
static const ww_parameter PARAMETERS[] = {
#ifdef BAD_BOUNDS
    {"a", "1", "inertia", "", 1, -1},
#else
    {"a", "1", "inertia", "", 0, 0},
#endif
    {"b", "1", "gain", "", -1, INFINITY},
};

#ifndef HANG_AT_ONCE
#define HANG_AT_ONCE 0
#endif

/* Counts calls, so that a test sees what the host did. */
WW_EXPORT int ww_test_stops = 0;
WW_EXPORT int ww_test_closes = 0;

static void hang(void)
{
    for (;;)
        sleep(1000);
}

static ww_status check(const char *config, const ww_message *message)
{
    double value = 0;
#ifdef HANG_IN_CHECK
    hang();
#endif
    return ww_number(config, "value", &value, message);
}

static ww_status open_robot(const char *config, uint64_t seed, ww_robot_info *info, void **handle, const ww_message *message)
{
    double status = 0;
    (void)seed;
    if (ww_number(config, "open_status", &status, message))
        return WW_CONFIG;
    if (status != 0)
        return ww_fail(message, (ww_status)status, "opening gave %g", status);
#ifdef HANG_IN_OPEN
    hang();
#endif
    info->inputs = INPUTS;
    info->outputs = OUTPUTS;
    info->n_inputs = 1;
#ifdef NO_OUTPUTS
    info->n_outputs = 0;
#elif defined(HUGE_COUNT)
    info->n_outputs = (size_t)-1;
#else
    info->n_outputs = 2;
#endif
#ifdef NULL_CHANNELS
    info->outputs = NULL;
#endif
#ifdef BAD_PERIOD
    info->period = NAN;
#else
    info->period = 0.01;
#endif
    *handle = calloc(1, sizeof(double));
    return WW_OK;
}

static ww_status measure(void *handle, double *time, double *measured, const ww_message *message)
{
    (void)message;
    *time = *(double *)handle;
    measured[0] = 1.0;
#if defined(NAN_OUTPUT) || defined(NAN_MEASURED)
    measured[1] = NAN;
#elif defined(FORGOTTEN_OUTPUT)
#else
    measured[1] = 2.0;
#endif
#ifdef OVERRUN
    measured[2] = 3.0;
#endif
    return WW_OK;
}

static ww_status step(void *handle, const double *command, double *time, double *measured, const ww_message *message)
{
    char text[5000];
#ifdef HANG_IN_STEP
    if (command[0] > 0 || HANG_AT_ONCE)
        hang();
#endif
    if (command[0] >= 1) {
        memset(text, 'a', sizeof text - 1);
        text[sizeof text - 1] = '\0';
        return command[0] == 99 ? ww_fail(message, WW_FAULT, "%s", text) : ww_fail(message, (ww_status)command[0], "command %g", command[0]);
    }
#ifdef TIME_BACK
    *(double *)handle -= 0.01;
#else
    *(double *)handle += 0.01;
#endif
    return measure(handle, time, measured, message);
}

static ww_status stop(void *handle, const ww_message *message)
{
    (void)handle;
    (void)message;
    ww_test_stops++;
#ifdef HANG_IN_STOP
    hang();
#endif
    return WW_OK;
}

static void close_robot(void *handle)
{
    ww_test_closes++;
    free(handle);
}

static ww_status open_model(const char *config, ww_model_info *info, void **handle, const ww_message *message)
{
    double status = 0;
    if (ww_number(config, "open_status", &status, message))
        return WW_CONFIG;
    if (status != 0)
        return ww_fail(message, (ww_status)status, "opening gave %g", status);
#ifdef HANG_IN_OPEN
    hang();
#endif
    info->inputs = INPUTS;
    info->n_inputs = 1;
    info->outputs = OUTPUTS;
    info->n_outputs = 1;
    info->parameters = PARAMETERS;
    info->n_parameters = 2;
    info->n_equations = 1;
    *handle = NULL;
    return WW_OK;
}

static ww_status regressor(const void *handle, const double *inputs, const double *outputs, const double *accelerations, double *phi,
                           double *y, const ww_message *message)
{
    (void)handle;
#ifdef NOT_AFFINE
    phi[0] = accelerations[0] * accelerations[0];
#else
    phi[0] = accelerations[0];
#endif
#ifndef FORGOTTEN_OUTPUT
    phi[1] = -inputs[0];
#endif
    y[0] = -outputs[0];
#ifdef OVERRUN
    y[1] = 0;
#endif
#ifdef NAN_OUTPUT
    phi[1] = NAN;
#endif
    if (inputs[0] == 7)
        phi[1] = NAN;
    if (inputs[0] == 9)
        hang();
    if (inputs[0] == 8)
        return ww_fail(message, WW_DRIVER, "eight is too many");
    return WW_OK;
}

static void close_model(void *handle)
{
    (void)handle;
    ww_test_closes++;
}

#ifdef NOT_UTF8
#define NAME "m\xff"
#elif defined(EMPTY_NAME)
#define NAME ""
#elif defined(NULL_NAME)
#define NAME NULL
#elif defined(TAKEN_NAME)
#define NAME "built-in-mock"
#else
#define NAME "mock"
#endif
#ifdef NULL_FUNCTION
#define STEP NULL
#else
#define STEP step
#endif

static const ww_robot ROBOT = {NAME, "a robot to break", NULL, check, open_robot, measure, STEP, stop, close_robot};
static const ww_model MODEL = {NAME, "a model to break", NULL, check, open_model, regressor, NULL, close_model};
#ifdef TWIN_NAMES
static const ww_robot *const ROBOTS[] = {&ROBOT, &ROBOT, NULL};
#else
static const ww_robot *const ROBOTS[] = {&ROBOT, NULL};
#endif
static const ww_model *const MODELS[] = {&MODEL, NULL};

static ww_plugin plugin = {WW_HEADER, "broken", "0.1", ROBOTS, MODELS, NULL, NULL};

#ifdef VENDOR_SYMBOL
extern int vendor_symbol_that_is_missing(void);
int call_vendor(void)
{
    return vendor_symbol_that_is_missing();
}
#endif

#ifdef HANG_IN_CONSTRUCTOR
__attribute__((constructor)) static void constructor(void)
{
    hang();
}
#endif

#ifdef NO_SYMBOL
#define wheelwright_plugin another_function
WW_EXPORT const ww_plugin *another_function(void);
#endif

const ww_plugin *wheelwright_plugin(void)
{
    (void)hang;
    (void)step;
#if defined(NULL_DESCRIPTOR)
    return NULL;
#elif defined(MISALIGNED)
    return (const ww_plugin *)((const char *)&plugin + 1);
#elif defined(WRONG_VERSION)
    plugin.header.abi_version = 1;
#elif defined(WRONG_SIZE)
    plugin.header.size_robot_info = 40;
#elif defined(OFFERS_NOTHING)
    plugin.robots = NULL;
    plugin.models = NULL;
#elif defined(RESERVED)
    plugin.solvers = (const void *const *)MODELS;
#elif defined(NULL_VERSION)
    plugin.version = NULL;
#endif
    return &plugin;
}
