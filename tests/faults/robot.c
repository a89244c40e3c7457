/* A robot in real time that writes down what it is told, and a model for it. At its STRIKE-th command something goes wrong, chosen by
 * -D: FREEZE (what it measures stays), HANG (the command does not return), HANG_LAW (the model does not, when it is asked next). */
#include <math.h>
#include <unistd.h>
#include <wheelwright_plugin.h>

#define STRIKE 20
#define PERIOD 0.05
#define LAG 0.1

static const ww_channel INPUTS[] = {{"v_ref", "m/s"}, {"omega_ref", "rad/s"}};
static const ww_channel OUTPUTS[] = {{"v", "m/s"}, {"omega", "rad/s"}, {"x", "m"}, {"y", "m"}, {"phi", "rad"}};
static const ww_parameter PARAMETERS[] = {
    {"lag_v", "s", "lag of v", "changes of v_ref", 0, 0},
    {"gain_v", "1", "v_ref for one unit of v", "driving", 0, 0},
    {"lag_omega", "s", "lag of omega", "changes of omega_ref", 0, 0},
    {"gain_omega", "1", "omega_ref for one unit of omega", "turning", 0, 0},
};

static volatile int commands = 0;
static double now = 0;
static double state[5];

static void told(const char *what)
{
    FILE *log = fopen("told", "a");
    if (log) {
        fprintf(log, "%s\n", what);
        fclose(log);
    }
}

static void hang(void)
{
    for (;;)
        sleep(1000);
}

static ww_status open_robot(const char *config, uint64_t seed, ww_robot_info *info, void **handle, const ww_message *message)
{
    (void)config, (void)seed, (void)message;
    *info = (ww_robot_info){INPUTS, OUTPUTS, 2, 5, PERIOD};
    *handle = state;
    return WW_OK;
}

static ww_status measure(void *handle, double *time, double *measured, const ww_message *message)
{
    (void)handle, (void)message;
    *time = now;
    memcpy(measured, state, sizeof state);
    return WW_OK;
}

static ww_status step(void *handle, const double *command, double *time, double *measured, const ww_message *message)
{
    char text[80];
    int frozen = 0;
    double share = 1 - exp(-PERIOD / LAG);
    snprintf(text, sizeof text, "%g %g", command[0], command[1]);
    told(text);
    commands++;
    usleep((useconds_t)(1e6 * PERIOD));
#ifdef FREEZE
    frozen = commands >= STRIKE;
#endif
#ifdef HANG
    if (commands >= STRIKE)
        hang();
#endif
    now += PERIOD;
    if (!frozen) {
        state[0] += share * (command[0] - state[0]);
        state[1] += share * (command[1] - state[1]);
        state[2] += PERIOD * state[0] * cos(state[4]);
        state[3] += PERIOD * state[0] * sin(state[4]);
        state[4] += PERIOD * state[1];
    }
    return measure(handle, time, measured, message);
}

static ww_status stop(void *handle, const ww_message *message)
{
    (void)handle, (void)message;
    told("stop");
    return WW_OK;
}

static ww_status open_model(const char *config, ww_model_info *info, void **handle, const ww_message *message)
{
    (void)config, (void)handle, (void)message;
    info->inputs = INPUTS;
    info->outputs = OUTPUTS;
    info->parameters = PARAMETERS;
    info->n_inputs = info->n_outputs = info->n_equations = 2;
    info->n_parameters = 4;
    return WW_OK;
}

static ww_status regressor(const void *handle, const double *inputs, const double *outputs, const double *accelerations, double *phi,
                           double *y, const ww_message *message)
{
    const double rows[] = {accelerations[0], outputs[0], 0, 0, 0, 0, accelerations[1], outputs[1]};
    (void)handle, (void)message;
#ifdef HANG_LAW
    if (commands >= STRIKE)
        hang();
#endif
    memcpy(phi, rows, sizeof rows);
    memcpy(y, inputs, 2 * sizeof *y);
    return WW_OK;
}

static void close_nothing(void *handle)
{
    (void)handle;
    (void)hang;
}

static const ww_robot ROBOT = {"scribe", "a robot that writes down what it is told", NULL, NULL, open_robot, measure, step, stop,
                               close_nothing};
static const ww_model MODEL = {"two-lags", "a lag on each axis", NULL, NULL, open_model, regressor, NULL, close_nothing};
static const ww_robot *const ROBOTS[] = {&ROBOT, NULL};
static const ww_model *const MODELS[] = {&MODEL, NULL};
static const ww_plugin PLUGIN = {.header = WW_HEADER, .name = "scribe", .version = "1.0", .robots = ROBOTS, .models = MODELS};

const ww_plugin *wheelwright_plugin(void)
{
    return &PLUGIN;
}
