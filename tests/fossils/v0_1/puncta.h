/* Tables that Puncta's host and its plugins exchange.
 * Generated from the crate puncta-abi: cargo xtask abi. */

#ifndef PUNCTA_H
#define PUNCTA_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#define PUNCTA_SYMBOL "puncta_plugin_v0_1"
#define PUNCTA_CALL_1 "call/1"
#define PUNCTA_DATA_1 "data/1"
#define PUNCTA_JOB_1 "job/1"
#define PUNCTA_DEVICE_CORE_1 "device.core/1"
#define PUNCTA_EXPORTED puncta_plugin_v0_1


// The number `n` of the current ABI `v0_<n>`; a change of layout bumps it.
#define PUNCTA_ABI_NUMBER 1

// The call did what it should.
#define PUNCTA_STATUS_OK 0

// The call failed; the reason was given to `job/1.fail`.
#define PUNCTA_STATUS_FAILED 1

// The call stopped because the host asked it to.
#define PUNCTA_STATUS_CANCELLED 2

// The plugin panicked; the text was given to `job/1.fail` where that was possible.
#define PUNCTA_STATUS_PANICKED 3

// `prepare` of a reader: the file is not of a kind that this reader knows.
#define PUNCTA_STATUS_NOT_MINE 4

// A handle, index or pointer that the callee does not know.
#define PUNCTA_STATUS_MISUSE 5

// The host has no room for what was asked.
#define PUNCTA_STATUS_NO_MEMORY 6

// Element kind of a column or image: unsigned 8 bit (also a boolean).
#define PUNCTA_KIND_U8 1

// Signed 8 bit.
#define PUNCTA_KIND_I8 2

// Unsigned 16 bit.
#define PUNCTA_KIND_U16 3

// Signed 16 bit.
#define PUNCTA_KIND_I16 4

// Unsigned 32 bit.
#define PUNCTA_KIND_U32 5

// Signed 32 bit.
#define PUNCTA_KIND_I32 6

// Unsigned 64 bit.
#define PUNCTA_KIND_U64 7

// Signed 64 bit.
#define PUNCTA_KIND_I64 8

// IEEE 754 binary32; NaN means "missing".
#define PUNCTA_KIND_F32 9

// IEEE 754 binary64; NaN means "missing".
#define PUNCTA_KIND_F64 10

// Truth value in one byte, 0 or 1.
#define PUNCTA_KIND_BOOL 11

// UTF-8 text, addressed by `rows + 1` offsets.
#define PUNCTA_KIND_UTF8 12

// u32 codes into a table of UTF-8 texts.
#define PUNCTA_KIND_DICTIONARY 13

// UTF-8 text: `len` bytes at `ptr`. `ptr` may be null when `len` is 0.
typedef struct {
  // First byte.
  const uint8_t *ptr;
  // Number of bytes.
  uint64_t len;
} puncta_str;

// What the host gives to a plugin's `create`. Frozen per major number.
typedef struct {
  // `size_of::<Host>()` at the host's build.
  uint32_t size;
  // Major ABI version.
  uint32_t major;
  // Minor ABI version.
  uint32_t minor;
  // `ABI_NUMBER` of the host's build while `major` is 0.
  uint32_t number;
  // The table with this id, valid until the process ends, or null.
  const void *(*get)(puncta_str id);
} puncta_host;

// What a plugin exports under `SYMBOL`. Frozen per major number.
typedef struct {
  // `size_of::<Plugin>()` at the plugin's build.
  uint32_t size;
  // Major ABI version; 0 until the first release.
  uint32_t major;
  // Minor ABI version; informs messages only.
  uint32_t minor;
  // `ABI_NUMBER` of the plugin's build while `major` is 0.
  uint32_t number;
  // Writes the manifest document (`puncta.plugin/1`) to `out`; valid until the process ends.
  uint32_t (*describe)(puncta_str *out);
  // Makes an instance. `host` is valid until `destroy` returns.
  uint32_t (*create)(const puncta_host *host, uint64_t *out);
  // Ends an instance that `create` made.
  void (*destroy)(uint64_t instance);
  // The table with this id, valid until the process ends, or null.
  const void *(*get)(puncta_str id);
} puncta_plugin;

// What `prepare` returns.
typedef struct {
  // The plugin's own number for the prepared call.
  uint64_t handle;
  // The plan document (`puncta.plan/1`), valid until `drop` of this plan.
  puncta_str document;
} puncta_plan;

// Calls of operations, readers and writers: the plugin's side.
typedef struct {
  // `size_of::<Call1>()`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Checks a request document (`puncta.request/1`) and plans the call without heavy work. A
  // reader may look at the head of its file, and returns `STATUS_NOT_MINE`
  // when it is of another kind.
  uint32_t (*prepare)(uint64_t instance, uint64_t job, puncta_str request, puncta_plan *plan);
  // Does what `plan` says. A plan may be run more than once.
  uint32_t (*run)(uint64_t instance, uint64_t job, uint64_t plan);
  // Forgets a plan.
  void (*drop)(uint64_t instance, uint64_t plan);
} puncta_call_1;

// One column of plain contiguous memory.
//
// Numbers lie at `data`, `rows * width` of them. UTF-8 columns have `rows + 1` `offsets` into
// `text` and no `data`. Dictionary columns have u32 codes at `data`, and `entries + 1` `offsets`
// into `text`. Inputs are mapped read-only. Memory is aligned to 64 bytes and padded to a multiple of 64.
typedef struct {
  // Numbers or codes; null for UTF-8.
  uint8_t *data;
  // Offsets into `text`; null for numbers.
  uint64_t *offsets;
  // Text bytes; null for numbers.
  uint8_t *text;
  // Rows there are (input) or room for rows (output).
  uint64_t rows;
  // Dictionary entries there are, or room for them.
  uint64_t entries;
  // Text bytes there are, or room for them.
  uint64_t text_bytes;
  // One of the `KIND_` numbers.
  uint32_t kind;
  // Numbers per row: 1, or the length of a fixed-size list.
  uint32_t width;
} puncta_column;

// Inputs and outputs of a running call: the host's side.
//
// An input is addressed by its place in the request's `inputs`, an output by the number that
// `begin` gives. `part` is 0 except for meshes (0 vertices, 1 triangles).
typedef struct {
  // `size_of::<Data1>()`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Columns of an input, in the order in which the plan names them, or of an output, in the
  // order of its document. Writes at most `capacity` and always the true number to `count`.
  // Pointers stay valid until `run` returns, or until `grow` or `finish` of that output.
  uint32_t (*columns)(uint64_t job,
                      uint64_t object,
                      uint32_t part,
                      puncta_column *out,
                      uint32_t capacity,
                      uint32_t *count);
  // Begins an output described by a document (`puncta.output/1`) and writes its number. The room
  // may hold anything, except that the first offset of texts is 0.
  uint32_t (*begin)(uint64_t job, puncta_str document, uint64_t *object);
  // Makes room for `rows` rows in all. Ask for the columns again afterwards.
  uint32_t (*grow)(uint64_t job, uint64_t object, uint32_t part, uint64_t rows);
  // Makes the next `rows` rows usable; others may read them from now on.
  uint32_t (*commit)(uint64_t job, uint64_t object, uint32_t part, uint64_t rows);
  // Ends an output with `rows[part]` rows. `header` is a document whose members replace those
  // of the output's header, or empty. An output that is not finished when `run` returns is dropped.
  uint32_t (*finish)(uint64_t job,
                     uint64_t object,
                     const uint64_t *rows,
                     uint32_t parts,
                     puncta_str header);
  // Gives a figure or a report as a document (`puncta.figure/1`, `puncta.report/1`).
  uint32_t (*emit)(uint64_t job, puncta_str document);
} puncta_data_1;

// Progress, cancel, failure, messages and threads of a call: the host's side.
typedef struct {
  // `size_of::<Job1>()`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Says how far the call is (0 to 1) and what it is doing. Returns
  // `STATUS_CANCELLED` when the call should stop.
  uint32_t (*progress)(uint64_t job, double fraction, puncta_str phase);
  // 0, or `STATUS_CANCELLED` when the call should stop. Cheap: poll
  // it at least every 50 ms.
  uint32_t (*cancelled)(uint64_t job);
  // Says why the call is about to fail, as a document (`puncta.failure/1`). The last one counts.
  void (*fail)(uint64_t job, puncta_str document);
  // A message for the log: level 1 error, 2 warning, 3 information, 4 detail.
  void (*log)(uint64_t job, uint32_t level, puncta_str message);
  // Number of threads that `parallel_for` uses.
  uint32_t (*threads)(uint64_t job);
  // Calls `task` for ranges that together cover `0..count`, each at most `grain` long, on the
  // host's threads, and returns when all are done, with the first result other than 0.
  uint32_t (*parallel_for)(uint64_t job,
                           uint64_t count,
                           uint64_t grain,
                           uint32_t (*task)(void *context, uint64_t begin, uint64_t end),
                           void *context);
} puncta_job_1;

// Instruments: the plugin's side. What moves or settles is started, then polled: a function with
// `seconds` (finite, 0 or more) returns at most 50 ms after them, every other function at once.
//
// One thread calls a device, and may call several. Only `halt` may come from any thread, after
// `open` has returned and before `close` is called; the host sees to that order.
//
// Where the status is not 0, `message` receives a sentence that stays valid until the next call of
// a function of this table on the same thread. Every device is closed before its `instance` is
// destroyed. When the host goes away, its worker calls `halt`, `safe_state` and `close`, and ends.
typedef struct {
  // `size_of::<DeviceCore1>()`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Opens the device that a document (`puncta.device-settings/1`) describes. Moves nothing.
  uint32_t (*open)(uint64_t instance,
                   puncta_str settings,
                   double seconds,
                   uint64_t *device,
                   puncta_str *message);
  // Writes the document (`puncta.device/1`) of its properties: name, unit, min, max, read_only.
  // Valid until the next `describe` of this device or its `close`. Asks the device nothing.
  uint32_t (*describe)(uint64_t device, puncta_str *document);
  // Reads a property; no answer in time is a failure. `STATUS_CANCELLED` after `halt`.
  uint32_t (*read)(uint64_t device,
                   puncta_str property,
                   double seconds,
                   double *value,
                   puncta_str *message);
  // Starts bringing a property to `value` and writes a token, which is never 0. A value outside
  // the limits, and a read-only property, are refused and change nothing.
  uint32_t (*start)(uint64_t device,
                    puncta_str property,
                    double value,
                    uint64_t *token,
                    puncta_str *message);
  // Waits for a token: `done` is 0 while it runs, which is no failure, and 1 when the property
  // has arrived and settled. 0 seconds: looks only. `STATUS_CANCELLED` after `halt`,
  // `safe_state` or a later `start` of the property, whatever the token's motion came to.
  uint32_t (*poll)(uint64_t device,
                   uint64_t token,
                   double seconds,
                   uint32_t *done,
                   puncta_str *message);
  // Stops what moves where it is, and ends every token. A function that runs on the device
  // returns `STATUS_CANCELLED` within 50 ms. Any thread.
  uint32_t (*halt)(uint64_t device, puncta_str *message);
  // Brings the device to a state that harms nobody and nothing, and waits until it is there. It
  // is told to go there even if it has stopped answering.
  uint32_t (*safe_state)(uint64_t device, double seconds, puncta_str *message);
  // Closes the device, which stays as it is.
  void (*close)(uint64_t device);
} puncta_device_core_1;

#endif  /* PUNCTA_H */
