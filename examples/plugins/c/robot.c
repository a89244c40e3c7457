/* A simulated base in C: both velocities follow their references with a time constant.
 *   cc -shared -fPIC -I../../../plugin/include robot.c -o librobot_c.so -lm
 * and in the configuration: [[plugin]] path = "librobot_c.so"; [robot] type = "c-base", tau = 0.2
 */
#include <math.h>
#include <wheelwright_plugin.h>

typedef struct {
    double tau, period, t, v, omega;
} base;

static const ww_channel INPUTS[] = {{"v_ref", "m/s"}, {"omega_ref", "rad/s"}};
static const ww_channel OUTPUTS[] = {{"v", "m/s"}, {"omega", "rad/s"}};
static const char *const KEYS[] = {"tau", "period", NULL};

static ww_status settings(const char *config, base *b, const ww_message *message)
{
    *b = (base){.tau = 0.3, .period = 0.05};
    if (ww_number(config, "tau", &b->tau, message) || ww_number(config, "period", &b->period, message))
        return WW_CONFIG;
    if (!(b->tau > 0))
        return ww_fail(message, WW_CONFIG, "`tau`: must be above 0 s, not %g", b->tau);
    return WW_OK;
}

static ww_status check(const char *config, const ww_message *message)
{
    base b;
    return settings(config, &b, message);
}

static ww_status open_base(const char *config, uint64_t seed, ww_robot_info *info, void **handle, const ww_message *message)
{
    base *b = malloc(sizeof *b);
    (void)seed; /* nothing here is random */
    if (!b)
        return ww_fail(message, WW_DRIVER, "out of memory");
    if (settings(config, b, message)) {
        free(b);
        return WW_CONFIG;
    }
    *info = (ww_robot_info){INPUTS, OUTPUTS, 2, 2, b->period, .simulated = 1};
    *handle = b;
    return WW_OK;
}

static ww_status measure(void *handle, double *time, double *measured, const ww_message *message)
{
    base *b = handle;
    (void)message; /* a simulated base does not fail */
    *time = b->t;
    measured[0] = b->v;
    measured[1] = b->omega;
    return WW_OK;
}

static ww_status step(void *handle, const double *command, double *time, double *measured, const ww_message *message)
{
    base *b = handle;
    double share = 1 - exp(-b->period / b->tau);
    b->v += share * (command[0] - b->v);
    b->omega += share * (command[1] - b->omega);
    b->t += b->period;
    return measure(handle, time, measured, message);
}

static ww_status stop(void *handle, const ww_message *message)
{
    (void)handle; /* a real robot gets zero velocities here and its motors disabled */
    (void)message;
    return WW_OK;
}

static const ww_robot BASE = {"c-base", "a base with a time constant, in C", KEYS, check, open_base, measure, step, stop, free};
static const ww_robot *const ROBOTS[] = {&BASE, NULL};
static const ww_plugin PLUGIN = {.header = WW_HEADER, .name = "c-robot-example", .version = "1.0", .robots = ROBOTS};

const ww_plugin *wheelwright_plugin(void)
{
    return &PLUGIN;
}
