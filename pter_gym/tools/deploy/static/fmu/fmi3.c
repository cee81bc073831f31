/* FMI 3.0, co-simulation. */

#include "instance.h"

typedef void Log(void *environment, int status, const char *category, const char *message);

#ifdef FMI3_FUNCTION_PREFIX
#define JOINED(a, b) a##b
#define PREFIXED(a, b) JOINED(a, b)
#define NAME(name) PREFIXED(FMI3_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI(kind, name) EXPORTED kind NAME(name)

static void tell(const Instance *instance, Status status, const char *message)
{
    static const char *const categories[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError"};
    ((Log *)instance->logger)(instance->environment, (int)status, categories[status], message);
}

FMI(const char *, fmi3GetVersion)(void)
{
    return "3.0";
}

FMI(int, fmi3SetDebugLogging)(Instance *instance, bool is_on, size_t count, const char *const categories[])
{
    (void)count, (void)categories;
    instance->is_logging = is_on;
    return OK;
}

FMI(Instance *, fmi3InstantiateCoSimulation)(const char *name, const char *token, const char *resources, bool visible,
                                       bool is_logging, bool events, bool early, const uint32_t intermediate[],
                                       size_t count, void *environment, Log *logger, void (*update)(void))
{
    (void)resources, (void)visible, (void)events, (void)early, (void)intermediate, (void)count, (void)update;
    return instance_new(name, token, environment, (void (*)(void))logger, tell, is_logging);
}

FMI(Instance *, fmi3InstantiateModelExchange)(const char *name, const char *token, const char *resources, bool visible,
                                        bool is_logging, void *environment, Log *logger)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)is_logging;
    if (logger)
        logger(environment, ERROR, "logStatusError", "this unit is for co-simulation");
    return NULL;
}

FMI(Instance *, fmi3InstantiateScheduledExecution)(const char *name, const char *token, const char *resources,
                                             bool visible, bool is_logging, void *environment, Log *logger,
                                             void (*update)(void), void (*lock)(void), void (*unlock)(void))
{
    (void)update, (void)lock, (void)unlock;
    return NAME(fmi3InstantiateModelExchange)(name, token, resources, visible, is_logging, environment, logger);
}

FMI(void, fmi3FreeInstance)(Instance *instance)
{
    instance_free(instance);
}

FMI(int, fmi3EnterInitializationMode)(Instance *instance, bool has_tolerance, double tolerance, double start,
                                  bool has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return instance_begin(instance, start);
}

FMI(int, fmi3ExitInitializationMode)(Instance *instance)
{
    return instance_initialised(instance);
}

FMI(int, fmi3Terminate)(Instance *instance)
{
    return instance_terminate(instance);
}

FMI(int, fmi3Reset)(Instance *instance)
{
    return instance_reset(instance);
}

FMI(int, fmi3SetFloat64)(Instance *instance, const uint32_t references[], size_t count, const double values[], size_t n)
{
    (void)n;
    return instance_set_numbers(instance, references, count, values);
}

FMI(int, fmi3GetFloat64)(Instance *instance, const uint32_t references[], size_t count, double values[], size_t n)
{
    (void)n;
    return instance_get_numbers(instance, references, count, values);
}

FMI(int, fmi3SetInt32)(Instance *instance, const uint32_t references[], size_t count, const int32_t values[], size_t n)
{
    (void)n;
    return instance_set_integers(instance, references, count, values);
}

FMI(int, fmi3GetInt32)(Instance *instance, const uint32_t references[], size_t count, int32_t values[], size_t n)
{
    (void)n;
    return instance_get_integers(instance, references, count, values);
}

FMI(int, fmi3DoStep)(Instance *instance, double point, double step, bool is_final, bool *has_event, bool *is_over,
                 bool *is_early, double *reached)
{
    Status status = instance_step(instance, point, step);
    (void)is_final;
    *has_event = false;
    *is_early = false;
    *is_over = instance->state.has_ended;
    *reached = instance_time(instance);
    return status;
}

FMI(int, fmi3GetFMUState)(Instance *instance, void **saved)
{
    return instance_save(instance, saved);
}

FMI(int, fmi3SetFMUState)(Instance *instance, void *saved)
{
    return instance_restore(instance, saved);
}

FMI(int, fmi3FreeFMUState)(Instance *instance, void **saved)
{
    return instance_free_saved(instance, saved);
}

FMI(int, fmi3SerializedFMUStateSize)(Instance *instance, void *saved, size_t *size)
{
    (void)instance, (void)saved;
    *size = instance_saved_size();
    return OK;
}

FMI(int, fmi3SerializeFMUState)(Instance *instance, void *saved, unsigned char bytes[], size_t size)
{
    return instance_write(instance, saved, bytes, size);
}

FMI(int, fmi3DeserializeFMUState)(Instance *instance, const unsigned char bytes[], size_t size, void **saved)
{
    return instance_read(instance, bytes, size, saved);
}

/* What else FMI has: importers look all names up. Callers pass more than the first argument. */
#define REFUSED(name) \
    FMI(int, name)(const Instance *instance) \
    { \
        return instance_refuse(instance, #name); \
    }

REFUSED(fmi3EnterEventMode)
REFUSED(fmi3EnterStepMode)
REFUSED(fmi3GetFloat32)
REFUSED(fmi3GetInt8)
REFUSED(fmi3GetUInt8)
REFUSED(fmi3GetInt16)
REFUSED(fmi3GetUInt16)
REFUSED(fmi3GetUInt32)
REFUSED(fmi3GetInt64)
REFUSED(fmi3GetUInt64)
REFUSED(fmi3GetBoolean)
REFUSED(fmi3GetString)
REFUSED(fmi3GetBinary)
REFUSED(fmi3GetClock)
REFUSED(fmi3SetFloat32)
REFUSED(fmi3SetInt8)
REFUSED(fmi3SetUInt8)
REFUSED(fmi3SetInt16)
REFUSED(fmi3SetUInt16)
REFUSED(fmi3SetUInt32)
REFUSED(fmi3SetInt64)
REFUSED(fmi3SetUInt64)
REFUSED(fmi3SetBoolean)
REFUSED(fmi3SetString)
REFUSED(fmi3SetBinary)
REFUSED(fmi3SetClock)
REFUSED(fmi3GetNumberOfVariableDependencies)
REFUSED(fmi3GetVariableDependencies)
REFUSED(fmi3GetDirectionalDerivative)
REFUSED(fmi3GetAdjointDerivative)
REFUSED(fmi3EnterConfigurationMode)
REFUSED(fmi3ExitConfigurationMode)
REFUSED(fmi3GetIntervalDecimal)
REFUSED(fmi3GetIntervalFraction)
REFUSED(fmi3GetShiftDecimal)
REFUSED(fmi3GetShiftFraction)
REFUSED(fmi3SetIntervalDecimal)
REFUSED(fmi3SetIntervalFraction)
REFUSED(fmi3SetShiftDecimal)
REFUSED(fmi3SetShiftFraction)
REFUSED(fmi3EvaluateDiscreteStates)
REFUSED(fmi3UpdateDiscreteStates)
REFUSED(fmi3EnterContinuousTimeMode)
REFUSED(fmi3CompletedIntegratorStep)
REFUSED(fmi3SetTime)
REFUSED(fmi3SetContinuousStates)
REFUSED(fmi3GetContinuousStateDerivatives)
REFUSED(fmi3GetEventIndicators)
REFUSED(fmi3GetContinuousStates)
REFUSED(fmi3GetNominalsOfContinuousStates)
REFUSED(fmi3GetNumberOfEventIndicators)
REFUSED(fmi3GetNumberOfContinuousStates)
REFUSED(fmi3GetOutputDerivatives)
REFUSED(fmi3ActivateModelPartition)
