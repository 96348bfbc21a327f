/* A plugin that is right but for one thing: compiled with -DFAULT=F_x, it fails the check x and no other. Without a
 * fault it passes all. It has a source, an operation, a reader and a writer. */
#define _GNU_SOURCE
#include "help.h"

#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include <unistd.h>

enum {
    F_none, F_symbol_kind, F_tables, F_functions, F_describe, F_needs, F_create, F_describe_again, F_quick_to_open,
    F_plugin_id, F_operation_ids, F_sorted, F_titles, F_help, F_version, F_isolation, F_port_names, F_ports_of_kind,
    F_units, F_parameter_names, F_limits, F_defaults, F_column_needs, F_file_rules, F_examples, F_get_unknown,
    F_get_again, F_null_places, F_create_again, F_poor_host, F_future_host, F_plans, F_example_runs,
    F_outputs_declared, F_outputs_valid, F_progress, F_unknown_operation, F_bad_requests, F_future_request,
    F_at_limits, F_beyond_limits, F_reasons, F_empty_table, F_one_row, F_not_a_number, F_infinite, F_missing_columns,
    F_optional_inputs, F_large_table, F_prepare_quick, F_plan_again, F_any_thread, F_reads_within, F_wrong_types,
    F_inputs_unchanged, F_writes_within, F_same_again, F_writes_all, F_same_with_threads, F_same_in_worker,
    F_reentrant, F_cancel_soon, F_cancel_said, F_no_memory, F_panic_contained, F_memory_returned, F_nothing_open,
    F_no_late_calls, F_quiet, F_process_kept, F_probes, F_others_files, F_damaged_files, F_writer_writes,
    F_writer_fails, F_symbol,
};

#ifndef FAULT
#define FAULT F_none
#endif
#define IS(fault) (FAULT == F_##fault)
#define CRASH() abort()

#define ID (IS(plugin_id) ? "broken" : "test.broken")

static const puncta_data_1 *data;
static const puncta_job_1 *jobs;

/* --- What the plugin says of itself. */

static const char *double_entry(void) {
    static char text[4096];
    const char *extra = IS(parameter_names) ? ", {\"name\": \"Extra Value\", \"kind\": \"bool\", \"default\": false, \"help\": \"No.\"}"
        : IS(limits) ? ", {\"name\": \"extra\", \"kind\": \"number\", \"min\": 5, \"max\": 1, \"optional\": true, \"help\": \"No.\"}"
        : IS(defaults) ? ", {\"name\": \"extra\", \"kind\": \"number\", \"max\": 1, \"default\": 2, \"help\": \"No.\"}" : "";
    const char *port = IS(port_names) ? "Table" : "table";
    const char *source = "{\"op\": \"%s.source/1\"}";
    char step[128], example[512];
    snprintf(step, sizeof step, source, ID);
    snprintf(example, sizeof example, ", \"example\": {\"parameters\": {\"factor\": 3}, \"inputs\": {\"%s\": %s, \"other\": %s}}",
             port, step, step);
    snprintf(text, sizeof text,
             "{\"id\": \"%s.double%s\", \"kind\": \"operation\", \"title\": \"%s\", \"description\": \"Multiplies x.\","
             " \"inputs\": [{\"name\": \"%s\", \"kind\": \"table\", \"columns\": [{\"name\": \"x\", \"unit\": \"nm\"}%s]},"
             "   {\"name\": \"other\", \"kind\": \"table\", \"optional\": true}],"
             " \"outputs\": [{\"name\": \"table\", \"kind\": \"table\", \"form\": \"columns\", \"of\": \"%s\"}],"
             " \"parameters\": [{\"name\": \"factor\", \"kind\": \"number\", \"unit\": \"%s\", \"default\": 2, \"min\": 0,"
             "   \"max\": 10, \"help\": \"%s\"}%s]%s}",
             ID, IS(operation_ids) ? "" : "/1", IS(titles) ? "" : "Double", port,
             IS(column_needs) ? ", {\"name\": \"$nothing\"}" : "", port, IS(units) ? "parsec" : "1",
             IS(help) ? "" : "What x is multiplied with.", extra, IS(examples) ? "" : example);
    return text;
}

static const char *reader_entry(void) {
    static char text[1024];
    snprintf(text, sizeof text,
             "{\"id\": \"%s.read/1\", \"kind\": \"reader\", \"title\": \"Reader\", \"description\": \"Reads numbers.\","
             " \"inputs\": [%s], \"outputs\": [{\"name\": \"points\", \"kind\": \"table\"}],"
             " \"file\": {\"suffixes\": [\"%s\"], \"magic\": [\"42524b31\"], \"formats\": [\"Broken numbers\"]},"
             " \"example\": {\"file\": {\"name\": \"a.brk\", \"text\": \"BRK1\\n1\\n2.5\\n4\\n10\\n\"}}}",
             ID, IS(ports_of_kind) ? "{\"name\": \"extra\", \"kind\": \"table\", \"optional\": true}" : "",
             IS(file_rules) ? "BRK" : ".brk");
    return text;
}

static const char *source_entry(void) {
    static char text[512];
    snprintf(text, sizeof text,
             "{\"id\": \"%s.source/1\", \"kind\": \"operation\", \"title\": \"Source\", \"description\": \"Makes points.\","
             " \"outputs\": [{\"name\": \"points\", \"kind\": \"table\"}], \"example\": {}}", ID);
    return text;
}

static const char *writer_entry(void) {
    static char text[1024];
    snprintf(text, sizeof text,
             "{\"id\": \"%s.write/1\", \"kind\": \"writer\", \"title\": \"Writer\", \"description\": \"Writes numbers.\","
             " \"inputs\": [{\"name\": \"table\", \"kind\": \"table\", \"columns\": [{\"name\": \"x\", \"unit\": \"nm\"}]}],"
             " \"file\": {\"suffixes\": [\".brk\"]},"
             " \"example\": {\"inputs\": {\"table\": {\"op\": \"%s.source/1\"}}}}", ID, ID);
    return text;
}

static uint32_t describe(puncta_str *out) {
    static char text[16384];
    static int times;
    if (IS(quick_to_open) && times == 0) usleep(1300000);
    if (!out && !IS(null_places)) return PUNCTA_STATUS_MISUSE;
    if (IS(describe)) {
        *out = TEXT("{\"format\": \"puncta.plugin/1\", \"id\": 7");
        return PUNCTA_STATUS_OK;
    }
    times++;
    snprintf(text, sizeof text,
             "{\"format\": \"puncta.plugin/1\", \"id\": \"%s\", \"title\": \"Broken\", \"version\": \"%s\","
             " \"license\": \"MIT\", \"isolation\": \"%s\", \"reentrant\": true, \"needs\": [\"data/1\", \"job/1\"%s]%s,"
             " \"description\": \"Is right but for one thing, %d.\", \"operations\": [%s, %s, %s, %s]}",
             ID, IS(version) ? "new" : "1.0.0", IS(isolation) ? "maybe" : "none", IS(needs) ? ", \"scene/9\"" : "",
             IS(panic_contained) ? ", \"sdk\": \"0.1.0\"" : "", IS(describe_again) ? times : 0, double_entry(),
             reader_entry(), IS(sorted) ? writer_entry() : source_entry(),
             IS(sorted) ? source_entry() : writer_entry());
    *out = text_of(text);
    return PUNCTA_STATUS_OK;
}

/* --- Calls. */

typedef struct {
    char operation, path[1024], plan[1024];
    double factor;
    bool used;
} call;

static _Thread_local void *prepared_here;

static uint32_t prepare_reader(uint64_t job, call *prepared) {
    char head[4] = "";
    FILE *file = fopen(prepared->path, "rb");
    if (!file) return fail(jobs, job, "io", "the file cannot be opened");
    size_t count = fread(head, 1, 4, file);
    fclose(file);
    if (!IS(others_files) && (count < 4 || memcmp(head, "BRK1", 4) != 0))
        return fail(jobs, job, "not-mine", "the file does not begin with BRK1");
    snprintf(prepared->plan, sizeof prepared->plan,
             "{\"format\": \"puncta.plan/1\", \"probe\": {\"format\": \"Broken numbers\", \"confidence\": %d}}",
             IS(probes) ? 7 : 1);
    return PUNCTA_STATUS_OK;
}

static uint32_t prepare_double(uint64_t job, puncta_str request, call *prepared) {
    double rows = 0;
    const double *factor = &prepared->factor;
    bool number = json_number(request, "parameters.factor", &prepared->factor);
    if (IS(beyond_limits) && number && *factor == 11) CRASH();
    if (IS(reasons) && number && *factor == -1) return PUNCTA_STATUS_FAILED;
    if (!number || !(*factor >= 0) || *factor > 10) return fail(jobs, job, "bad-parameter", "factor is from 0 to 10");
    if (IS(at_limits) && *factor == 10) return fail(jobs, job, "internal", "this should not happen");
    if (IS(future_request) && json_find(request, "later").len) return fail(jobs, job, "internal", "what is that");
    if (IS(optional_inputs) && json_find(request, "inputs.1").len == 0) CRASH();
    json_number(request, "inputs.0.header.parts.0.rows", &rows);
    if (IS(prepare_quick) && rows > 1e8) usleep(1300000);
    if (json_column(request, 0, "x") < 0) {
        if (IS(missing_columns)) CRASH();
        return fail(jobs, job, "bad-input", "the table has no column x");
    }
    snprintf(prepared->plan, sizeof prepared->plan,
             "{\"format\": \"puncta.plan/1\", \"read\": [{\"input\": 0, \"columns\": [\"%s\"]}]}",
             IS(plans) ? "nothing" : "x");
    return PUNCTA_STATUS_OK;
}

static uint32_t prepare(uint64_t instance, uint64_t job, puncta_str request, puncta_plan *plan) {
    (void)instance;
    char operation[128] = "", prefix[64];
    if (IS(bad_requests) && json_find(request, "operation").len == 0) CRASH();
    json_text(request, "operation", operation, sizeof operation);
    if (IS(panic_contained) && strstr(operation, "self-test")) abort();
    call *prepared = calloc(1, sizeof *prepared);
    if (!prepared) return fail(jobs, job, "resources", "there is no memory");
    snprintf(prefix, sizeof prefix, "%s.", ID);
    bool known = strncmp(operation, prefix, strlen(prefix)) == 0;
    const char *name = known ? operation + strlen(prefix) : "";
    const char *suffix = IS(operation_ids) ? "" : "/1";
    char twice[16];
    snprintf(twice, sizeof twice, "double%s", suffix);
    json_text(request, "file.path", prepared->path, sizeof prepared->path);
    snprintf(prepared->plan, sizeof prepared->plan, "{\"format\": \"puncta.plan/1\"}");
    uint32_t status;
    if (strcmp(name, twice) == 0) {
        prepared->operation = 'd';
        status = prepare_double(job, request, prepared);
    } else if (strcmp(name, "read/1") == 0) {
        prepared->operation = 'r';
        status = prepare_reader(job, prepared);
    } else if (strcmp(name, "source/1") == 0) {
        prepared->operation = 's';
        status = PUNCTA_STATUS_OK;
    } else if (strcmp(name, "write/1") == 0) {
        prepared->operation = 'w';
        status = json_column(request, 0, "x") < 0 ? fail(jobs, job, "bad-input", "the table has no column x") : 0;
        snprintf(prepared->plan, sizeof prepared->plan,
                 "{\"format\": \"puncta.plan/1\", \"read\": [{\"input\": 0, \"columns\": [\"x\"]}]}");
    } else if (IS(unknown_operation)) {
        status = PUNCTA_STATUS_OK;
    } else {
        status = fail(jobs, job, "unsupported", "there is no such operation in this plugin");
    }
    if (status) {
        free(prepared);
        return status;
    }
    prepared_here = prepared;
    plan->handle = (uint64_t)(uintptr_t)prepared;
    plan->document = text_of(prepared->plan);
    return PUNCTA_STATUS_OK;
}

static void drop(uint64_t instance, uint64_t plan) {
    (void)instance;
    free((void *)(uintptr_t)plan);
}

static void *late(void *job) {
    usleep(50000);
    jobs->cancelled((uint64_t)(uintptr_t)job);
    return NULL;
}

/* Faults that any run may have. */
static uint32_t misbehave(uint64_t job) {
    if (IS(memory_returned)) {
        volatile char *lost = malloc(1 << 20);
        for (int i = 0; lost && i < 1 << 20; i += 4096) lost[i] = 1;
    }
    if (IS(nothing_open) && open("/dev/null", O_RDONLY) < 0) return PUNCTA_STATUS_FAILED;
    if (IS(quiet)) printf("hello\n");
    if (IS(process_kept)) {
        static int calls;
        char text[16];
        snprintf(text, sizeof text, "%d", ++calls);
        setenv("BROKEN_CALLS", text, 1);
    }
    if (IS(no_late_calls)) {
        pthread_t thread;
        if (!pthread_create(&thread, NULL, late, (void *)(uintptr_t)job)) pthread_detach(thread);
    }
    return PUNCTA_STATUS_OK;
}

static uint32_t begin(uint64_t job, const char *port, const char *form, const char *column, const char *unit,
                      uint64_t rows, puncta_column *out, uint64_t *output) {
    char document[768];
    uint32_t status, count;
    snprintf(document, sizeof document,
             "{\"format\": \"puncta.output/1\", \"output\": \"%s\"%s, \"header\": {\"kind\": \"table\", \"name\": \"%s\","
             " \"parts\": [{\"name\": \"rows\", \"rows\": %llu, \"columns\":"
             " [{\"name\": \"%s\", \"type\": \"f64\", \"unit\": \"%s\"}]}]}}",
             port, form, port, (unsigned long long)rows, column, unit);
    status = data->begin(job, text_of(document), output);
    if (status && IS(no_memory)) CRASH();
    if (status) return status;
    if ((status = data->columns(job, *output, 0, out, 1, &count))) return status;
    return data->commit(job, *output, 0, rows);
}

static void look(const puncta_column *x) {
    const double *values = (const double *)x->data;
    if (IS(empty_table) && x->rows == 0) CRASH();
    if (IS(one_row) && x->rows == 1) CRASH();
    if (IS(large_table) && x->rows > 200000) CRASH();
    if (x->kind != PUNCTA_KIND_F64) return;
    if (IS(reads_within) && isnan(((volatile const double *)values)[x->rows + 64])) return;
    for (uint64_t row = 0; row < x->rows; row++) {
        if (IS(not_a_number) && isnan(values[row])) CRASH();
        if (IS(infinite) && isinf(values[row])) CRASH();
    }
}

static uint32_t run_double(uint64_t job, const call *prepared) {
    static atomic_int runs;
    puncta_column x, out;
    uint32_t count = 0, status;
    uint64_t output;
    if ((status = data->columns(job, 0, 0, &x, 1, &count)) || count != 1)
        return fail(jobs, job, "bad-input", "the table has no column x");
    if (!IS(wrong_types) && (x.kind >= PUNCTA_KIND_UTF8 || x.width != 1))
        return fail(jobs, job, "bad-input", "column x is not of numbers");
    look(&x);
    if ((status = begin(job, "table", ", \"form\": \"columns\", \"of\": 0", "doubled",
                        IS(outputs_valid) ? "parsec" : "nm", x.rows, &out, &output)))
        return status;
    double *doubled = (double *)out.data;
    for (uint64_t row = 0; row < x.rows; row++) {
        if (row % 4096 == 0 && !IS(cancel_soon)) {
            double fraction = IS(progress) ? 7 : (double)row / (double)x.rows;
            status = jobs->progress(job, fraction, TEXT("doubling"));
            if (status && IS(cancel_said)) return fail(jobs, job, "no-convergence", "it came to nothing");
            if (status) return status;
        }
        if (IS(cancel_soon)) {
            volatile int spin = 0;
            while (spin < 3000) spin++;
        }
        if (IS(writes_all) && row + 1 == x.rows) break;
        doubled[row] = prepared->factor * (IS(wrong_types) && x.data ? ((double *)x.data)[row] : value_at(&x, row));
    }
    if (x.rows > 0) {
        if (IS(inputs_unchanged)) ((double *)x.data)[0] = 77;
        if (IS(writes_within)) ((volatile double *)doubled)[x.rows] = 1;
        if (IS(same_again)) doubled[0] += atomic_fetch_add(&runs, 1);
        if (IS(same_with_threads)) doubled[0] += jobs->threads(job);
        if (IS(same_in_worker) && getenv("PUNCTA_WORKER")) doubled[0] += 1;
    }
    if ((status = data->finish(job, output, &x.rows, 1, TEXT("")))) return status;
    if (IS(outputs_declared)) {
        const uint64_t one = 1;
        if ((status = begin(job, "more", "", "y", "nm", 1, &out, &output))) return status;
        *(double *)out.data = 1;
        return data->finish(job, output, &one, 1, TEXT(""));
    }
    return PUNCTA_STATUS_OK;
}

static uint32_t run_source(uint64_t job) {
    puncta_column out;
    uint64_t output, rows = 300;
    uint32_t status = begin(job, "points", "", "x", "nm", rows, &out, &output);
    if (status) return status;
    for (uint64_t row = 0; row < rows; row++) ((double *)out.data)[row] = (double)(row * 37 % 300) + 0.5;
    return data->finish(job, output, &rows, 1, TEXT(""));
}

static uint32_t run_reader(uint64_t job, const call *prepared) {
    char text[4096], *at = text + 5;
    FILE *file = fopen(prepared->path, "rb");
    if (!file) return fail(jobs, job, "io", "the file cannot be opened");
    size_t size = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    text[size] = 0;
    if (IS(damaged_files) && size < 9) CRASH();
    if (size < 5) return fail(jobs, job, "bad-file", "the file is cut short");
    double numbers[1024];
    uint64_t rows = 0, output;
    while (rows < 1024) {
        char *rest;
        double number = strtod(at, &rest);
        if (rest == at) break;
        numbers[rows++] = number;
        at = rest;
    }
    at += strspn(at, "\n");
    if (*at || at < text + size) return fail(jobs, job, "bad-file", "a line of the file is no number");
    puncta_column out;
    uint32_t status = begin(job, "points", "", "x", "nm", rows, &out, &output);
    if (status) return status;
    if (rows) memcpy(out.data, numbers, rows * sizeof *numbers);
    return data->finish(job, output, &rows, 1, TEXT(""));
}

static uint32_t run_writer(uint64_t job, const call *prepared) {
    puncta_column x;
    uint32_t count = 0;
    if (data->columns(job, 0, 0, &x, 1, &count) || count != 1)
        return fail(jobs, job, "bad-input", "the table has no column x");
    if (x.kind >= PUNCTA_KIND_UTF8 || x.width != 1) return fail(jobs, job, "bad-input", "column x is not of numbers");
    char path[1100];
    snprintf(path, sizeof path, "%s%s", prepared->path, IS(writer_writes) ? ".x" : "");
    FILE *file = fopen(path, "wb");
    if (!file) return IS(writer_fails) ? PUNCTA_STATUS_OK : fail(jobs, job, "io", "the file cannot be written");
    fputs("BRK1\n", file);
    for (uint64_t row = 0; row < x.rows; row++) {
        uint32_t status = row % 4096 ? 0 : jobs->cancelled(job);
        if (status) {
            fclose(file);
            return status;
        }
        fprintf(file, "%.17g\n", value_at(&x, row));
    }
    return fclose(file) ? fail(jobs, job, "io", "the file cannot be written") : PUNCTA_STATUS_OK;
}

static uint32_t run(uint64_t instance, uint64_t job, uint64_t plan) {
    static atomic_int inside;
    (void)instance;
    call *prepared = (call *)(uintptr_t)plan;
    if (IS(example_runs)) return fail(jobs, job, "no-convergence", "it does not work today");
    if (IS(plan_again) && prepared->used) return fail(jobs, job, "bad-input", "the plan was used before");
    prepared->used = true;
    if (IS(any_thread) && prepared_here != prepared) return fail(jobs, job, "bad-input", "what plan is that");
    if (IS(reentrant)) {
        if (atomic_fetch_add(&inside, 1)) {
            atomic_fetch_sub(&inside, 1);
            return fail(jobs, job, "bad-input", "one at a time, please");
        }
        usleep(5000);
    }
    uint32_t status = misbehave(job);
    if (!status)
        status = prepared->operation == 'd' ? run_double(job, prepared)
            : prepared->operation == 's' ? run_source(job)
            : prepared->operation == 'r' ? run_reader(job, prepared)
            : prepared->operation == 'w' ? run_writer(job, prepared) : PUNCTA_STATUS_MISUSE;
    if (IS(reentrant)) atomic_fetch_sub(&inside, 1);
    return status;
}

/* --- The table. */

static uint32_t create(const puncta_host *host, uint64_t *out) {
    static int times;
    if ((!host || !out) && !IS(null_places)) return PUNCTA_STATUS_MISUSE;
    if (IS(create)) return PUNCTA_STATUS_FAILED;
    if (IS(future_host) && host->size != sizeof(puncta_host)) return PUNCTA_STATUS_FAILED;
    if (IS(create_again) && times++) return PUNCTA_STATUS_FAILED;
    const puncta_data_1 *its_data = host->get(TEXT(PUNCTA_DATA_1));
    const puncta_job_1 *its_jobs = host->get(TEXT(PUNCTA_JOB_1));
    if ((!its_data || !its_jobs) && !IS(poor_host)) return PUNCTA_STATUS_FAILED;
    data = its_data;
    jobs = its_jobs;
    *out = 1;
    return PUNCTA_STATUS_OK;
}

static void destroy(uint64_t instance) { (void)instance; }

static const void *get(puncta_str id) {
    static const puncta_call_1 calls = {sizeof calls, 0, prepare, run, drop};
    if (IS(get_unknown) && id.len >= 6 && memcmp(id.ptr, PUNCTA_CALL_1, 6) == 0) return &calls;
    if (!text_is(id, PUNCTA_CALL_1)) return NULL;
    if (!IS(get_again)) return &calls;
    puncta_call_1 *copy = malloc(sizeof *copy);
    if (copy) *copy = calls;
    return copy;
}

#define TABLE {IS(tables) ? 8 : sizeof(puncta_plugin), 0, 1, PUNCTA_ABI_NUMBER, describe, create, IS(functions) ? NULL : destroy, get}

#ifdef AS_FUNCTION
__attribute__((used)) const puncta_plugin table = TABLE;
__asm__(".globl puncta_plugin_v0_1\n.set puncta_plugin_v0_1, table\n.type puncta_plugin_v0_1, @function\n");
#elif defined(OTHER_NUMBER)
PUNCTA_EXPORT const puncta_plugin puncta_plugin_v0_4711 = TABLE;
#else
PUNCTA_EXPORT const puncta_plugin PUNCTA_EXPORTED = TABLE;
#endif
