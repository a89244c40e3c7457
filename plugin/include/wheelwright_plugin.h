/* wheelwright_plugin.h: robots, models and effects of Wheelwright in a shared library.
 *
 * A library exports one function, wheelwright_plugin(), that returns a static ww_plugin: who it is and NULL-terminated lists
 * of what it offers. The guide is docs/plugins.md; examples/plugins/c holds a robot, a model and an effect.
 *
 * Rules
 *  - Nothing is allocated on one side and freed on the other. Texts and arrays that the library hands out stay valid and
 *    unchanged: those of ww_plugin, ww_robot, ww_model and ww_effect for ever (a library is never unloaded), those written to an
 *    info until close (or release). Texts are UTF-8.
 *  - Configuration arrives as TOML text: the user's table with `type`, one `dotted.key = value` a line, values on one line.
 *  - A call that fails returns a status and writes a message with ww_fail(). A WW_CONFIG message that begins with `key`: (in
 *    backticks) puts the error at that key; a WW_TIMEOUT message may begin with the limit, as in "0.5 s: no odometry".
 *  - No C++ exception, no longjmp, no exit() may leave a call. A crash of the library is a crash of the program.
 *  - Units are SI; every value given and returned must be finite.
 *
 * Licence: MIT OR Apache-2.0, as the rest of Wheelwright.
 */
#ifndef WHEELWRIGHT_PLUGIN_H
#define WHEELWRIGHT_PLUGIN_H

#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Raised with every change of a structure or a rule; a host loads exactly its own version. */
#define WW_ABI_VERSION 5u

#if defined(_WIN32)
#define WW_EXPORT __declspec(dllexport)
#else
#define WW_EXPORT __attribute__((visibility("default")))
#endif

/* What a call returns: the classes that a user can act on. */
typedef int32_t ww_status;
enum {
    WW_OK = 0,
    WW_CONFIG = 1,     /* a configuration value is impossible */
    WW_CONNECTION = 2, /* no connection, or it was lost */
    WW_TIMEOUT = 3,    /* no answer in time */
    WW_FAULT = 4,      /* the robot reports a fault */
    WW_DRIVER = 5,     /* the library itself failed */
    WW_SINGULAR = 6    /* a model's equations leave the accelerations undetermined */
};

/* The host's buffer for a message; never NULL. Write at most `capacity` bytes including the closing NUL. */
typedef struct ww_message {
    char *text;
    size_t capacity;
} ww_message;

/* A signal by name and SI unit, such as {"v_ref", "m/s"}. */
typedef struct ww_channel {
    const char *name;
    const char *unit;
} ww_channel;

/* A connected robot; written by `open`, zeroed before. Arrays stay the library's. */
typedef struct ww_robot_info {
    const ww_channel *inputs;  /* commands, such as v_ref, omega_ref */
    const ww_channel *outputs; /* measurements, such as v, omega, x, y, phi */
    size_t n_inputs;
    size_t n_outputs;
    double period; /* control period [s] */
    /* Not 0: time passes only in `step`, as fast as it returns, as in a simulation. 0: a period takes its time by the world's clock,
     * so that a late command is late, and there is a countdown before anything moves. */
    uint32_t simulated;
} ww_robot_info;

/* A robot. One handle's calls come one at a time and from one thread, but for two: when a call has not returned within the
 * host's limit, `stop` is called from another thread while that call still runs, so `stop` must tolerate it (an atomic
 * flag and a write to the port are enough); and `close` may then come from another thread. */
typedef struct ww_robot {
    const char *name;         /* what `type = "..."` says */
    const char *about;        /* one line for `wheelwright plugins` */
    const char *const *keys;  /* NULL-terminated keys of the table; others are refused. NULL: `check` and `open` refuse them */
    /* Checks a configuration without connecting. NULL: only `open` finds errors. */
    ww_status (*check)(const char *config, const ww_message *message);
    /* Connects. `seed` drives whatever is random in a simulated robot. On failure nothing stays open. */
    ww_status (*open)(const char *config, uint64_t seed, ww_robot_info *info, void **handle, const ww_message *message);
    /* Reads n_outputs values and the robot's time [s] without commanding. */
    ww_status (*measure)(void *handle, double *time, double *measured, const ww_message *message);
    /* Holds n_inputs command values for one period, then measures. */
    ww_status (*step)(void *handle, const double *command, double *time, double *measured, const ww_message *message);
    /* Commands zero and disables the motors. At any time, more than once. */
    ww_status (*stop)(void *handle, const ww_message *message);
    /* The last call for a handle; `stop` came before. */
    void (*close)(void *handle);
} ww_robot;

/* A parameter of a model. Leave both bounds 0 for none; -INFINITY and INFINITY make one side free. */
typedef struct ww_parameter {
    const char *name;
    const char *unit;       /* SI; "1" for a pure number */
    const char *meaning;    /* what it does, one plain sentence */
    const char *excitation; /* the motion that shows it, such as "changes of v_ref while driving" */
    double lower;
    double upper;
} ww_parameter;

/* A model; written by `open`, zeroed before. Arrays stay the library's. */
typedef struct ww_model_info {
    const ww_channel *inputs;
    const ww_channel *outputs; /* their time derivatives are the accelerations */
    const ww_parameter *parameters;
    /* Equalities between parameters: theta = matrix z + offset with n_free names, row-major matrix. All NULL and 0: none. */
    const char *const *free_names;
    const double *map_matrix;
    const double *map_offset;
    size_t n_inputs;
    size_t n_outputs;
    size_t n_parameters;
    size_t n_equations; /* as many as outputs if the model is to be simulated */
    size_t n_free;
} ww_model_info;

/* A model: phi(inputs, outputs, accelerations) theta = y, affine in the accelerations. Calls for one handle may come from
 * several threads at once: they only read it. `regressor` is the innermost loop: no allocation, no lock, no waiting. */
typedef struct ww_model {
    const char *name;
    const char *about;
    const char *const *keys;
    ww_status (*check)(const char *config, const ww_message *message); /* may be NULL */
    ww_status (*open)(const char *config, ww_model_info *info, void **handle, const ww_message *message);
    /* Writes phi (row-major, n_equations x n_parameters) and y (n_equations). */
    ww_status (*regressor)(const void *handle, const double *inputs, const double *outputs, const double *accelerations, double *phi,
                           double *y, const ww_message *message);
    /* Writes the accelerations that solve phi theta = y. NULL: the host solves. */
    ww_status (*accelerations)(const void *handle, const double *theta, const double *inputs, const double *outputs,
                               double *accelerations, const ww_message *message);
    void (*close)(void *handle);
} ww_model;

/* ---- effects: physics that a model leaves out, see docs/plugins.md ---- */

/* Where an effect acts; effects of one simulation act in this order. */
enum {
    WW_TRANSPORT = 0, /* command: delay */
    WW_RAMP = 1,      /* command: limit of its rate of change */
    WW_THRESHOLD = 2, /* command: dead zone */
    WW_LIMIT = 3,     /* command: limit of its size */
    WW_GAIN = 4,      /* command: gains */
    WW_FILTER = 5,    /* command: filters */
    WW_LOOP = 6,      /* command: an outer loop that compares with the outputs */
    WW_BEARING = 7,   /* dynamics: input used up at the wheels, before anything reaches the ground */
    WW_LOAD = 8,      /* dynamics: input used up by a force on the robot */
    WW_DRIVE = 9,     /* dynamics: what the motors have left to accelerate */
    WW_CONTACT = 10,  /* dynamics: what the ground carries of it */
    WW_INERTIA = 11,  /* dynamics: what it accelerates */
    WW_READING = 12,  /* measurement: when that is looked at, after all sensors */
    WW_SENSOR = 13    /* measurement: what sensors make of the outputs */
};

/* How a model's channels are motion. */
enum {
    WW_BODY = 0,    /* v_ref, omega_ref -> v, omega; wheel speeds are v -+ half_track omega */
    WW_SIDES = 1,   /* u_left, u_right -> vel_left, vel_right */
    WW_CHANNELS = 2 /* nothing is known */
};

/* Another effect (or parameter of the model) that looks alike, and why, in one sentence. */
typedef struct ww_confusion {
    const char *with;
    const char *because;
} ww_confusion;

/* An effect with its settings; written by `open`, zeroed before. */
typedef struct ww_effect_info {
    const char *family;     /* variants of one cause share one, "cause/part" is a part of it; NULL: its name */
    const char *excitation; /* the motion that shows it */
    const ww_confusion *confusions;
    size_t n_confusions;
    uint32_t stage; /* WW_TRANSPORT ... WW_SENSOR */
    uint32_t reserved;
} ww_effect_info;

/* What an effect may know of a recording: typical sizes. The host's, valid until `release`. */
typedef struct ww_scene {
    const ww_channel *inputs;
    const ww_channel *outputs;
    const double *input_rms;     /* root mean square of each input */
    const double *input_largest; /* largest magnitude of each */
    const double *output_rms;
    size_t n_inputs;
    size_t n_outputs;
    double half_track;      /* half the track width [m]; NAN without wheels */
    double wheel_radius;    /* [m]; NAN if not known */
    double speed;           /* root mean square of the wheels' ground speeds [m/s]; of all outputs without wheels */
    double command;         /* root mean square of the wheels' commands */
    double largest_command; /* largest magnitude of a wheel's command */
    double start;           /* first and last time of the recording [s] */
    double end;
    double period; /* median step between samples [s] */
    uint32_t frame; /* WW_BODY, WW_SIDES or WW_CHANNELS */
    uint32_t reserved;
} ww_scene;

/* A parameter of an effect. */
typedef struct ww_effect_parameter {
    const char *name;
    const char *unit;
    const char *label_kind; /* "wheel", "axis", or NULL */
    const char *label;      /* "left", "omega", or NULL */
    double lower;           /* physical bounds: a friction is not negative; -INFINITY and INFINITY are allowed */
    double upper;
    double scale;   /* plausible size: starts and difference steps are measured in it */
    double neutral; /* the value at which it does nothing; NAN for a shape that has none */
} ww_effect_parameter;

/* A point from which an effect is tried. */
typedef struct ww_start {
    const double *values;   /* one a parameter */
    const int32_t *columns; /* one a parameter: number of its column of the screening, from 0; -1: it keeps its value throughout */
    uint32_t linear;        /* 1: the response is proportional to the columns' parameters */
    uint32_t reserved;
} ww_start;

/* An effect on a scene; written by `prepare`, zeroed before. */
typedef struct ww_prepared_info {
    const char *inapplicable; /* the reason why it cannot act here, or NULL; nothing else is read then */
    const ww_effect_parameter *parameters;
    const ww_start *starts;
    size_t n_parameters;
    size_t n_starts;
    size_t n_states; /* numbers of its own, in every call from `begin` on */
} ww_prepared_info;

/* What was recorded. Columns of `rows` values; a command is held from its time to the next. */
typedef struct ww_stretch {
    const double *time;
    const double *const *inputs;
    const double *const *outputs;
    const double *heading;        /* measured [rad]; NULL without wheels */
    const double *distance_left;  /* measured, rolled by the left wheel [m]; NULL without wheels */
    const double *distance_right;
    size_t rows;
} ww_stretch;

/* One instant of a simulation. */
typedef struct ww_instant {
    double time; /* [s], on the recording's clock */
    double span; /* time that passes up to now in this call; 0 where a state is only looked at */
    size_t row;  /* whose command is held */
    const ww_stretch *stretch;
    uint32_t interval_mean; /* 1 where outputs are recorded as means since the sample before */
    uint32_t reserved;
} ww_instant;

/* What a drive effect sees of the motion. `inertia` and `drag`, inputs x outputs, are the inputs that a unit of each acceleration
 * needs and that a unit of each output takes to be held; `held`, one an input, is what the ground gives besides what accelerates
 * the robot: the model's part that is not linear, and the loads on the robot itself. Zeros where no drive effect acts. */
typedef struct ww_motion {
    const double *u; /* the command behind the command effects */
    const double *outputs;
    const double *inertia;
    const double *drag;
    const double *held;
} ww_motion;

/* A value with its 95 % interval; NAN where there is none. */
typedef struct ww_estimate {
    double value;
    double lower;
    double upper;
} ww_estimate;

/* Writes the true outputs at an earlier time of the stretch. */
typedef void (*ww_past)(const void *host, double time, double *outputs);

/* An effect. `p` are its parameters' values, `state` its n_states numbers. An effect fills the hooks of its stage and leaves the
 * others NULL. Hooks are the innermost loop, may come from several threads at once, and allocate and wait for nothing; a hook that
 * fails writes NAN. */
typedef struct ww_effect {
    const char *name;
    const char *about;
    const char *const *keys;
    ww_status (*check)(const char *config, const ww_message *message); /* may be NULL */
    ww_status (*open)(const char *config, ww_effect_info *info, void **handle, const ww_message *message);
    /* Suits it to a scene. */
    ww_status (*prepare)(const void *handle, const ww_scene *scene, ww_prepared_info *info, void **prepared, const ww_message *message);
    /* Writes one plain sentence with magnitudes and units: return ww_fail(text, WW_OK, "the wheels need %.2f V to move", value); */
    ww_status (*statement)(const void *prepared, const ww_estimate *values, const ww_message *text);
    /* Sets the state at the start of a stretch. NULL: zeros. */
    void (*begin)(const void *prepared, const double *p, const ww_instant *at, const double *inputs, const double *outputs, double *state);
    /* The next time at which it switches by itself, so that no step spans it; INFINITY if never. NULL: never. */
    double (*next_switch)(const void *prepared, const double *p, const ww_instant *at, const double *state);
    /* Command stages: lets `span` pass and changes u from what arrived to what goes on. A span of 0 follows each switch.
     * `outputs` are those of that moment for WW_LOOP, for the others those at the start of the step. */
    void (*command)(const void *prepared, const double *p, const ww_instant *at, const double *outputs, double *state, double *u);
    /* WW_BEARING and WW_LOAD: adds the input that is used up. */
    void (*load)(const void *prepared, const double *p, const ww_instant *at, const double *outputs, const double *state, double *load);
    /* WW_DRIVE, WW_CONTACT and WW_INERTIA: changes the input that is left for acceleration. */
    void (*drive)(const void *prepared, const double *p, const ww_instant *at, const ww_motion *motion, const double *state,
                  double *drive);
    /* WW_BEARING to WW_INERTIA with state: lets `span` pass. */
    void (*advance)(const void *prepared, const double *p, const ww_instant *at, const ww_motion *motion, const double *drive,
                    double *state);
    /* WW_READING and WW_SENSOR: changes the outputs that are recorded at a sample. */
    void (*measure)(const void *prepared, const double *p, const ww_instant *at, ww_past past, const void *host, double *state,
                    double *outputs);
    void (*release)(void *prepared); /* ends what `prepare` made */
    void (*close)(void *handle);     /* the last call; everything prepared was released before */
} ww_effect;

/* Version and sizes as the library was compiled; write WW_HEADER. */
typedef struct ww_header {
    uint32_t abi_version; /* first for ever */
    uint32_t size_plugin;
    uint32_t size_robot;
    uint32_t size_robot_info;
    uint32_t size_model;
    uint32_t size_model_info;
    uint32_t size_channel;
    uint32_t size_parameter;
    uint32_t size_effect;
    uint32_t size_effect_info;
    uint32_t size_scene;
    uint32_t size_effect_parameter;
    uint32_t size_prepared_info;
    uint32_t size_instant;
} ww_header;

/* What a library offers. Lists end with NULL; a NULL list is empty. */
typedef struct ww_plugin {
    ww_header header;
    const char *name;
    const char *version;
    const ww_robot *const *robots;
    const ww_model *const *models;
    const void *const *solvers; /* reserved for a later version: NULL */
    const ww_effect *const *effects;
} ww_plugin;

#define WW_HEADER                                                                                                              \
    {                                                                                                                          \
        WW_ABI_VERSION, (uint32_t)sizeof(ww_plugin), (uint32_t)sizeof(ww_robot), (uint32_t)sizeof(ww_robot_info),              \
            (uint32_t)sizeof(ww_model), (uint32_t)sizeof(ww_model_info), (uint32_t)sizeof(ww_channel),                         \
            (uint32_t)sizeof(ww_parameter), (uint32_t)sizeof(ww_effect), (uint32_t)sizeof(ww_effect_info),                     \
            (uint32_t)sizeof(ww_scene), (uint32_t)sizeof(ww_effect_parameter), (uint32_t)sizeof(ww_prepared_info),             \
            (uint32_t)sizeof(ww_instant)                                                                                       \
    }

/* The one exported symbol. */
WW_EXPORT const ww_plugin *wheelwright_plugin(void);

/* ---- help for plugin authors; nothing below is part of the binary interface ---- */

#if defined(__GNUC__)
#define WW_HELPER static inline __attribute__((unused))
#define WW_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define WW_HELPER static inline
#define WW_PRINTF(text, first)
#endif

/* Writes a message, cut to the buffer, and returns `status`: return ww_fail(message, WW_FAULT, "battery at %.1f V", u); */
WW_HELPER ww_status ww_fail(const ww_message *message, ww_status status, const char *format, ...) WW_PRINTF(3, 4);
WW_HELPER ww_status ww_fail(const ww_message *message, ww_status status, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message->text, message->capacity, format, arguments);
    va_end(arguments);
    return status;
}

/* The text of a key's value up to the end of its line, or NULL. */
WW_HELPER const char *ww_value(const char *config, const char *key)
{
    size_t length = strlen(key);
    const char *line = config;
    while (line && *line) {
        if (strncmp(line, key, length) == 0 && strncmp(line + length, " = ", 3) == 0)
            return line + length + 3;
        line = strchr(line, '\n');
        if (line)
            line++;
    }
    return NULL;
}

/* Reads a number; an absent key leaves *value as it is. */
WW_HELPER ww_status ww_number(const char *config, const char *key, double *value, const ww_message *message)
{
    const char *text = ww_value(config, key);
    char *end = NULL;
    double number;
    if (!text)
        return WW_OK;
    number = strtod(text, &end);
    if (end == text || (*end != '\n' && *end != '\0'))
        return ww_fail(message, WW_CONFIG, "`%s`: must be a number, not %.*s", key, (int)strcspn(text, "\n"), text);
    *value = number;
    return WW_OK;
}

/* Reads true or false as 1 or 0; an absent key leaves *value as it is. */
WW_HELPER ww_status ww_flag(const char *config, const char *key, int *value, const ww_message *message)
{
    const char *text = ww_value(config, key);
    if (!text)
        return WW_OK;
    if (strncmp(text, "true", 4) == 0)
        *value = 1;
    else if (strncmp(text, "false", 5) == 0)
        *value = 0;
    else
        return ww_fail(message, WW_CONFIG, "`%s`: must be true or false, not %.*s", key, (int)strcspn(text, "\n"), text);
    return WW_OK;
}

/* Reads a text into a buffer; an absent key leaves it as it is. The escapes \" and \\ are resolved, others refused. */
WW_HELPER ww_status ww_text(const char *config, const char *key, char *value, size_t capacity, const ww_message *message)
{
    const char *text = ww_value(config, key);
    size_t length = 0;
    if (!text)
        return WW_OK;
    if (*text++ != '"')
        return ww_fail(message, WW_CONFIG, "`%s`: must be a text in quotes", key);
    while (*text && *text != '"') {
        if (*text == '\\') {
            text++;
            if (*text != '"' && *text != '\\')
                return ww_fail(message, WW_CONFIG, "`%s`: may not hold control characters", key);
        }
        if (length + 1 >= capacity)
            return ww_fail(message, WW_CONFIG, "`%s`: is longer than %lu bytes", key, (unsigned long)(capacity - 1));
        value[length++] = *text++;
    }
    value[length] = '\0';
    return WW_OK;
}

/* The command that was held at a time, not later than now; before the stretch, its first. */
WW_HELPER double ww_held(const ww_instant *at, double time, size_t input)
{
    size_t row = at->row;
    while (row > 0 && at->stretch->time[row] > time)
        row--;
    return at->stretch->inputs[input][row];
}

/* ---- the layout, checked where pointers have 64 bits; the host checks the same numbers ---- */

#if defined(__cplusplus)
#define WW_LAYOUT(condition) static_assert(condition, #condition)
#else
#define WW_LAYOUT(condition) _Static_assert(condition, #condition)
#endif

#if UINTPTR_MAX == UINT64_MAX
WW_LAYOUT(sizeof(ww_message) == 16 && offsetof(ww_message, capacity) == 8);
WW_LAYOUT(sizeof(ww_channel) == 16 && offsetof(ww_channel, unit) == 8);
WW_LAYOUT(sizeof(ww_robot_info) == 48 && offsetof(ww_robot_info, n_inputs) == 16 && offsetof(ww_robot_info, simulated) == 40);
WW_LAYOUT(sizeof(ww_robot) == 72 && offsetof(ww_robot, check) == 24 && offsetof(ww_robot, step) == 48 && offsetof(ww_robot, close) == 64);
WW_LAYOUT(sizeof(ww_parameter) == 48 && offsetof(ww_parameter, excitation) == 24 && offsetof(ww_parameter, lower) == 32);
WW_LAYOUT(sizeof(ww_model_info) == 88 && offsetof(ww_model_info, free_names) == 24 && offsetof(ww_model_info, n_inputs) == 48 &&
          offsetof(ww_model_info, n_free) == 80);
WW_LAYOUT(sizeof(ww_model) == 64 && offsetof(ww_model, check) == 24 && offsetof(ww_model, regressor) == 40 && offsetof(ww_model, close) == 56);
WW_LAYOUT(sizeof(ww_header) == 56 && offsetof(ww_header, size_parameter) == 28 && offsetof(ww_header, size_instant) == 52);
WW_LAYOUT(sizeof(ww_plugin) == 104 && offsetof(ww_plugin, name) == 56 && offsetof(ww_plugin, robots) == 72 &&
          offsetof(ww_plugin, effects) == 96);
WW_LAYOUT(sizeof(ww_effect_info) == 40 && offsetof(ww_effect_info, stage) == 32);
WW_LAYOUT(sizeof(ww_scene) == 128 && offsetof(ww_scene, n_inputs) == 40 && offsetof(ww_scene, frame) == 120);
WW_LAYOUT(sizeof(ww_effect_parameter) == 64 && offsetof(ww_effect_parameter, neutral) == 56);
WW_LAYOUT(sizeof(ww_start) == 24 && sizeof(ww_prepared_info) == 48 && offsetof(ww_prepared_info, n_states) == 40);
WW_LAYOUT(sizeof(ww_motion) == 40 && offsetof(ww_motion, held) == 32);
WW_LAYOUT(sizeof(ww_stretch) == 56 && sizeof(ww_instant) == 40 && offsetof(ww_instant, stretch) == 24);
WW_LAYOUT(sizeof(ww_estimate) == 24 && sizeof(ww_effect) == 128 && offsetof(ww_effect, command) == 72 &&
          offsetof(ww_effect, close) == 120);
#endif

#ifdef __cplusplus
}
#endif

#endif
