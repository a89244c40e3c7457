/* A model in C: each velocity lags behind its reference, tau v' + v = k v_ref, written linear in tau and k as
 *   v' tau - v_ref k = -v
 *   cc -shared -fPIC -I../../../plugin/include model.c -o libmodel_c.so
 * and in the configuration: [[plugin]] path = "libmodel_c.so"; [model] type = "c-lag"
 */
#include <math.h>
#include <wheelwright_plugin.h>

static const ww_channel INPUTS[] = {{"v_ref", "m/s"}, {"omega_ref", "rad/s"}};
static const ww_channel OUTPUTS[] = {{"v", "m/s"}, {"omega", "rad/s"}};
static const ww_parameter PARAMETERS[] = {
    {"tau_v", "s", "time constant of the forward velocity", "changes of v_ref", 0, INFINITY},
    {"k_v", "1", "forward velocity per reference", "driving at different v_ref", 0, 0},
    {"tau_omega", "s", "time constant of the turning rate", "changes of omega_ref", 0, INFINITY},
    {"k_omega", "1", "turning rate per reference", "turning at different omega_ref", 0, 0},
};
static const char *const NO_KEYS[] = {NULL};

static ww_status open_lag(const char *config, ww_model_info *info, void **handle, const ww_message *message)
{
    (void)config; /* it has no keys */
    (void)message;
    info->inputs = INPUTS;
    info->n_inputs = 2;
    info->outputs = OUTPUTS;
    info->n_outputs = 2;
    info->parameters = PARAMETERS;
    info->n_parameters = 4;
    info->n_equations = 2;
    *handle = NULL; /* and no state */
    return WW_OK;
}

static ww_status regressor(const void *handle, const double *inputs, const double *outputs, const double *accelerations, double *phi,
                           double *y, const ww_message *message)
{
    int i;
    (void)handle;
    (void)message;
    memset(phi, 0, 8 * sizeof *phi);
    for (i = 0; i < 2; i++) { /* row i has its own two of the four columns */
        phi[4 * i + 2 * i] = accelerations[i];
        phi[4 * i + 2 * i + 1] = -inputs[i];
        y[i] = -outputs[i];
    }
    return WW_OK;
}

static void close_lag(void *handle)
{
    (void)handle;
}

static const ww_model LAG = {"c-lag", "a time constant and a gain for each velocity, in C", NO_KEYS, NULL, open_lag, regressor, NULL,
                             close_lag};
static const ww_model *const MODELS[] = {&LAG, NULL};
static const ww_plugin PLUGIN = {.header = WW_HEADER, .name = "c-model-example", .version = "1.0", .models = MODELS};

const ww_plugin *wheelwright_plugin(void)
{
    return &PLUGIN;
}
