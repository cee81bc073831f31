/* FMI 2.0, co-simulation. */

#include "instance.h"

typedef void Log(void *environment, const char *name, int status, const char *category, const char *message, ...);

typedef struct {
    Log *logger;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
} Callbacks;

#ifdef FMI2_FUNCTION_PREFIX
#define JOINED(a, b) a##b
#define PREFIXED(a, b) JOINED(a, b)
#define NAME(name) PREFIXED(FMI2_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI(kind, name) EXPORTED kind NAME(name)

enum { CO_SIMULATION = 1 };
enum { LAST_SUCCESSFUL_TIME = 2, IS_TERMINATED = 3 };

static void tell(const Instance *instance, Status status, const char *message)
{
    static const char *const categories[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError"};
    ((Log *)instance->logger)(instance->environment, instance->name ? instance->name : "", (int)status,
                              categories[status], "%s", message);
}

FMI(const char *, fmi2GetVersion)(void)
{
    return "2.0";
}

FMI(const char *, fmi2GetTypesPlatform)(void)
{
    return "default";
}

FMI(int, fmi2SetDebugLogging)(Instance *instance, int is_on, size_t count, const char *const categories[])
{
    (void)count, (void)categories;
    instance->is_logging = is_on;
    return OK;
}

FMI(Instance *, fmi2Instantiate)(const char *name, int kind, const char *token, const char *resources,
                           const Callbacks *callbacks, int visible, int is_logging)
{
    void *environment = callbacks ? callbacks->environment : NULL;
    void (*logger)(void) = callbacks ? (void (*)(void))callbacks->logger : NULL;
    (void)resources, (void)visible;
    return kind == CO_SIMULATION ? instance_new(name, token, environment, logger, tell, is_logging) : NULL;
}

FMI(void, fmi2FreeInstance)(Instance *instance)
{
    instance_free(instance);
}

FMI(int, fmi2SetupExperiment)(Instance *instance, int has_tolerance, double tolerance, double start, int has_stop,
                          double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    instance->begin = start;
    return OK;
}

FMI(int, fmi2EnterInitializationMode)(Instance *instance)
{
    return instance_begin(instance, instance->begin);
}

FMI(int, fmi2ExitInitializationMode)(Instance *instance)
{
    return instance_initialised(instance);
}

FMI(int, fmi2Terminate)(Instance *instance)
{
    return instance_terminate(instance);
}

FMI(int, fmi2Reset)(Instance *instance)
{
    return instance_reset(instance);
}

FMI(int, fmi2SetReal)(Instance *instance, const uint32_t references[], size_t count, const double values[])
{
    return instance_set_numbers(instance, references, count, values);
}

FMI(int, fmi2GetReal)(Instance *instance, const uint32_t references[], size_t count, double values[])
{
    return instance_get_numbers(instance, references, count, values);
}

FMI(int, fmi2SetInteger)(Instance *instance, const uint32_t references[], size_t count, const int32_t values[])
{
    return instance_set_integers(instance, references, count, values);
}

FMI(int, fmi2GetInteger)(Instance *instance, const uint32_t references[], size_t count, int32_t values[])
{
    return instance_get_integers(instance, references, count, values);
}

/* An episode that ends discards the rest of the step, and the status says why. */
FMI(int, fmi2DoStep)(Instance *instance, double point, double step, int is_final)
{
    Status status = instance_step(instance, point, step);
    (void)is_final;
    return status == OK && instance->state.has_ended ? DISCARD : status;
}

FMI(int, fmi2GetBooleanStatus)(Instance *instance, int kind, int *value)
{
    if (kind != IS_TERMINATED)
        return DISCARD;
    *value = instance->state.has_ended;
    return OK;
}

FMI(int, fmi2GetRealStatus)(Instance *instance, int kind, double *value)
{
    if (kind != LAST_SUCCESSFUL_TIME)
        return DISCARD;
    *value = instance_time(instance);
    return OK;
}

FMI(int, fmi2GetFMUstate)(Instance *instance, void **saved)
{
    return instance_save(instance, saved);
}

FMI(int, fmi2SetFMUstate)(Instance *instance, void *saved)
{
    return instance_restore(instance, saved);
}

FMI(int, fmi2FreeFMUstate)(Instance *instance, void **saved)
{
    return instance_free_saved(instance, saved);
}

FMI(int, fmi2SerializedFMUstateSize)(Instance *instance, void *saved, size_t *size)
{
    (void)instance, (void)saved;
    *size = instance_saved_size();
    return OK;
}

FMI(int, fmi2SerializeFMUstate)(Instance *instance, void *saved, unsigned char bytes[], size_t size)
{
    return instance_write(instance, saved, bytes, size);
}

FMI(int, fmi2DeSerializeFMUstate)(Instance *instance, const unsigned char bytes[], size_t size, void **saved)
{
    return instance_read(instance, bytes, size, saved);
}

/* What else FMI has: importers look all names up. Callers pass more than the first argument. */
#define REFUSED(name) \
    FMI(int, name)(const Instance *instance) \
    { \
        return instance_refuse(instance, #name); \
    }

REFUSED(fmi2GetBoolean)
REFUSED(fmi2GetString)
REFUSED(fmi2SetBoolean)
REFUSED(fmi2SetString)
REFUSED(fmi2GetDirectionalDerivative)
REFUSED(fmi2SetRealInputDerivatives)
REFUSED(fmi2GetRealOutputDerivatives)
REFUSED(fmi2CancelStep)
REFUSED(fmi2GetStatus)
REFUSED(fmi2GetIntegerStatus)
REFUSED(fmi2GetStringStatus)
