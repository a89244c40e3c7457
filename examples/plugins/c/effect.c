/* An effect in C: a drag with the cube of each speed, load = c y^3, as water or a long fibre carpet exert it on a fast robot.
 *   cc -shared -fPIC -I../../../plugin/include effect.c -o libeffect_c.so
 * and in the configuration: [[plugin]] path = "libeffect_c.so"; the effect is called "c_cubic_drag"
 */
#include <math.h>
#include <wheelwright_plugin.h>

#define MOST 16 /* no model has more channels for an effect of a library */

static const ww_confusion CONFUSIONS[] = {{"quadratic_drag", "over a narrow range of speeds a cube and a square look alike"}};
static const char *const NO_KEYS[] = {NULL};

/* The effect on one recording: nothing here points outside, so it may be freed as it is. */
typedef struct drag {
    ww_effect_parameter parameters[MOST];
    ww_start start;
    char units[MOST][96];
    double values[MOST];
    int32_t columns[MOST];
    size_t channels;
} drag;

static ww_status open_drag(const char *config, ww_effect_info *info, void **handle, const ww_message *message)
{
    (void)config; /* it has no keys */
    (void)message;
    info->stage = WW_LOAD;
    info->excitation = "driving and turning at low and at the highest speed";
    info->confusions = CONFUSIONS;
    info->n_confusions = 1;
    *handle = NULL; /* and no settings */
    return WW_OK;
}

static ww_status prepare(const void *handle, const ww_scene *scene, ww_prepared_info *info, void **prepared, const ww_message *message)
{
    drag *own;
    size_t i;
    (void)handle;
    if (scene->n_inputs != scene->n_outputs) {
        info->inapplicable = "inputs and outputs differ in number: which input moves which output is not known";
        *prepared = NULL;
        return WW_OK;
    }
    own = calloc(1, sizeof *own);
    if (!own)
        return ww_fail(message, WW_DRIVER, "no memory");
    own->channels = scene->n_inputs;
    for (i = 0; i < own->channels; i++) {
        double cube = scene->output_rms[i] * scene->output_rms[i] * scene->output_rms[i];
        ww_effect_parameter *p = &own->parameters[i];
        snprintf(own->units[i], sizeof own->units[i], "%s per cubed %s", scene->inputs[i].unit, scene->outputs[i].unit);
        p->name = "drag";
        p->unit = own->units[i];
        p->label_kind = "output";
        p->label = scene->outputs[i].name; /* the scene stays until release */
        p->lower = 0;
        p->upper = INFINITY;
        p->scale = 0.05 * scene->input_rms[i] / cube;
        p->neutral = 0;
        own->values[i] = p->scale;
        own->columns[i] = (int32_t)i; /* each channel a column of its own */
    }
    own->start.values = own->values;
    own->start.columns = own->columns;
    own->start.linear = 1;
    info->parameters = own->parameters;
    info->n_parameters = own->channels;
    info->starts = &own->start;
    info->n_starts = 1;
    *prepared = own;
    return WW_OK;
}

static ww_status statement(const void *prepared, const ww_estimate *values, const ww_message *text)
{
    const drag *own = prepared;
    char sentence[768] = "";
    size_t i, used = 0;
    for (i = 0; i < own->channels && used < sizeof sentence; i++) {
        const char *joint = i ? ", " : "";
        int written = isnan(values[i].lower)
                          ? snprintf(sentence + used, sizeof sentence - used, "%s%.3g %s", joint, values[i].value, own->units[i])
                          : snprintf(sentence + used, sizeof sentence - used, "%s%.3g (%.3g to %.3g) %s", joint, values[i].value,
                                     values[i].lower, values[i].upper, own->units[i]);
        if (written < 0)
            return WW_DRIVER;
        used += (size_t)written;
    }
    return ww_fail(text, WW_OK, "a drag grows with the cube of speed: %s; the model had none", sentence);
}

static void load(const void *prepared, const double *p, const ww_instant *at, const double *outputs, const double *state, double *load)
{
    const drag *own = prepared;
    size_t i;
    (void)at;
    (void)state;
    for (i = 0; i < own->channels; i++)
        load[i] += p[i] * outputs[i] * outputs[i] * outputs[i];
}

static void release(void *prepared)
{
    free(prepared);
}

static void close_drag(void *handle)
{
    (void)handle;
}

static const ww_effect DRAG = {.name = "c_cubic_drag",
                               .about = "a drag with the cube of speed, in C",
                               .keys = NO_KEYS,
                               .open = open_drag,
                               .prepare = prepare,
                               .statement = statement,
                               .load = load,
                               .release = release,
                               .close = close_drag};
static const ww_effect *const EFFECTS[] = {&DRAG, NULL};
static const ww_plugin PLUGIN = {.header = WW_HEADER, .name = "c-effect-example", .version = "1.0", .effects = EFFECTS};

const ww_plugin *wheelwright_plugin(void)
{
    return &PLUGIN;
}
