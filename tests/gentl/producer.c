/* A GenTL producer for tests: cameras in memory whose frames come from a scene in a projector's
   light. Written from the public GenTL standard 1.5 (EMVA). The folder in the environment variable
   FRINGEWORKS_PRODUCER holds camera.xml, the description of the registers, and control.bin, which
   the test maps too: the picture of the projector, the scene, and the faults. */
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define API __attribute__((visibility("default"))) int32_t
enum { OK = 0, FAILED = -1001, NOT_INITIALIZED = -1002, NOT_IMPLEMENTED = -1003, IN_USE = -1004,
       DENIED = -1005, INVALID_HANDLE = -1006, INVALID_ID = -1007, NO_DATA = -1008,
       INVALID_PARAMETER = -1009, IO = -1010, TIMEOUT = -1011, ABORT = -1012,
       NOT_AVAILABLE = -1014, INVALID_ADDRESS = -1015, TOO_SMALL = -1016, INVALID_INDEX = -1017 };
enum { STRING = 1, INT32 = 5, UINT32 = 6, INT64 = 7, UINT64 = 8, PTR = 10, BOOL8 = 11, SIZE = 12 };
#define CAMERAS 2
#define SIDE 128
#define BUFFERS 64
#define DESCRIPTION 0x10000
#define WHITE_US 10000.0

/* What the test maps: faults are counts of frames to come. */
typedef struct {
    uint32_t unplugged[CAMERAS], generation[CAMERAS], lost, incomplete, plugged, ptp_offset_ns;
    uint32_t spare[1016];
    double white[SIDE * SIDE], black[SIDE * SIDE];
    uint8_t picture[SIDE * SIDE];
} Control;

/* The registers, as camera.xml says; addresses are offsets. */
typedef struct {
    uint32_t width, height, x, y, format, sensor_width, sensor_height, payload;   /* 0x00 */
    double exposure_us, gain_db;                                                 /* 0x20 */
    uint32_t trigger_mode, trigger_source, trigger_selector, trigger;            /* 0x30 */
    uint32_t start, stop, exposure_auto, gain_auto;                              /* 0x40 */
    uint32_t ptp_enable, ptp_status, latch, mode;                                /* 0x50 */
    uint64_t latched;                                                            /* 0x60 */
    double rate_hz;                                                              /* 0x68 */
    int64_t ptp_offset;                                                          /* 0x70 */
    char vendor[32], model[32], serial[32];                                      /* 0x78 */
} Registers;

typedef struct { uint8_t *base; size_t size; void *user; int queued, incomplete, mine; size_t filled;
                 uint64_t id, stamp; uint32_t width, height, format; } Buffer;
typedef struct { int index; const char *id; Registers r; int open, streaming, running, dead;
                 uint32_t generation, triggers; uint64_t frame; pthread_t thread;
                 Buffer buffers[BUFFERS]; Buffer *in[BUFFERS], *out[BUFFERS]; int n_in, n_out; } Camera;

static Camera cameras[CAMERAS];
static Control *control;
static char *xml; static size_t xml_size;
static int initialized, system_open;
static int system_module, interface_module, device_module[CAMERAS], stream_module[CAMERAS];
static const char *const KINDS[] = {"TLSystem", "TLInterface", "TLDevice", "TLDataStream"};
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed;

/* ---- answers to questions ---- */
static int32_t give(const void *value, size_t n, int32_t kind, int32_t *type, void *to, size_t *size) {
    if (!size) return INVALID_PARAMETER;
    if (type) *type = kind;
    if (to) { if (*size < n) return TOO_SMALL; memcpy(to, value, n); }
    *size = n;
    return OK;
}
#define WORD(text) give(text, strlen(text) + 1, STRING, type, to, size)
#define NUMBER(ctype, kind, value) do { ctype v = (ctype)(value); return give(&v, sizeof v, kind, type, to, size); } while (0)
static uint64_t now_ns(clockid_t which) {
    struct timespec t; clock_gettime(which, &t);
    return 1000000000ull * t.tv_sec + t.tv_nsec;
}
static int gone(const Camera *c) {
    return c->dead || control->unplugged[c->index] || control->generation[c->index] != c->generation;
}
static uint64_t stamp(const Camera *c) {
    /* Without PTP, each camera counts from when it was switched on. */
    if (!c->r.ptp_enable) return now_ns(CLOCK_MONOTONIC) + 1000000000ull * (1 + 77 * c->index);
    return now_ns(CLOCK_REALTIME) + c->index * (uint64_t)control->ptp_offset_ns;
}
static Camera *device_of(void *h) {
    for (int k = 0; k < CAMERAS; k++) if (h == &device_module[k] || h == &stream_module[k] || h == &cameras[k]) return &cameras[k];
    return NULL;
}

/* ---- the sensor ---- */
static size_t bytes_per_pixel(const Registers *r) { return r->format == 0x01080001 ? 1 : 2; }
static void expose(const Camera *c, uint8_t *to) {
    const Registers *r = &c->r;
    double gain = pow(10, r->gain_db / 20);
    int wide = bytes_per_pixel(r) == 2;
    for (uint32_t row = 0; row < r->height; row++)
        for (uint32_t column = 0; column < r->width; column++) {
            size_t at = (row + r->y) * SIDE + column + r->x;
            double light = control->black[at] + (control->white[at] - control->black[at]) * (control->picture[at] / 255.0);
            double count = rint(light * r->exposure_us / WHITE_US * gain * (wide ? 16 : 1));
            double limit = wide ? 4095 : 255;
            count = count < 0 ? 0 : count > limit ? limit : count;
            size_t k = (size_t)row * r->width + column;
            if (wide) ((uint16_t *)to)[k] = (uint16_t)count; else to[k] = (uint8_t)count;
        }
}
/* The buffer with the next frame; NULL for a frame that is lost. */
static Buffer *frame(Camera *c) {
    c->frame++;
    if (control->lost) { control->lost--; return NULL; }
    if (!c->n_in) return NULL;
    Buffer *b = c->in[0];
    memmove(c->in, c->in + 1, --c->n_in * sizeof *c->in);
    b->width = c->r.width; b->height = c->r.height; b->format = c->r.format;
    b->filled = bytes_per_pixel(&c->r) * b->width * b->height;
    b->id = c->frame; b->stamp = stamp(c); b->incomplete = 0;
    if (b->filled > b->size) { b->filled = 0; b->incomplete = 1; }
    else expose(c, b->base);
    if (control->incomplete) {
        control->incomplete--; b->incomplete = 1; b->filled /= 2;
        memset(b->base + b->filled, 0xAA, b->filled);
    }
    return b;
}
static void *run(void *which) {
    Camera *c = which;
    pthread_mutex_lock(&lock);
    while (c->streaming) {
        int due = c->r.start && !gone(c) && (!c->r.trigger_mode || (c->r.trigger_source == 0 && c->triggers));
        Buffer *b = NULL;
        if (due) {
            if (c->triggers) c->triggers--;
            /* The picture at the beginning of the exposure, delivered after its end. */
            b = frame(c);
        }
        pthread_mutex_unlock(&lock);
        usleep(due ? (useconds_t)fmin(c->r.exposure_us, 20000.0) : 500);
        pthread_mutex_lock(&lock);
        if (b && c->streaming && !gone(c)) {
            c->out[c->n_out++] = b;
            pthread_cond_broadcast(&changed);
        }
    }
    pthread_mutex_unlock(&lock);
    return NULL;
}

/* ---- the library ---- */
API GCInitLib(void) {
    if (initialized) return IN_USE;
    const char *folder = getenv("FRINGEWORKS_PRODUCER");
    char path[4096];
    if (!folder) return FAILED;
    snprintf(path, sizeof path, "%s/control.bin", folder);
    int file = open(path, O_RDWR);
    if (file < 0) return FAILED;
    control = mmap(NULL, sizeof *control, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (control == MAP_FAILED) return FAILED;
    snprintf(path, sizeof path, "%s/camera.xml", folder);
    FILE *text = fopen(path, "rb");
    if (!text) return FAILED;
    fseek(text, 0, SEEK_END); xml_size = (size_t)ftell(text); rewind(text);
    xml = malloc(xml_size);
    if (fread(xml, 1, xml_size, text) != xml_size) { fclose(text); return FAILED; }
    fclose(text);
    pthread_condattr_t by; pthread_condattr_init(&by); pthread_condattr_setclock(&by, CLOCK_MONOTONIC);
    pthread_cond_init(&changed, &by);
    for (int k = 0; k < CAMERAS; k++) { cameras[k].index = k; cameras[k].id = k ? "FWCAM1" : "FWCAM0"; }
    initialized = 1;
    return OK;
}
API GCCloseLib(void) { if (!initialized) return NOT_INITIALIZED; initialized = 0; free(xml); munmap(control, sizeof *control); return OK; }
static int32_t system_info(int32_t what, int32_t *type, void *to, size_t *size) {
    switch (what) {
    case 0: return WORD("fringeworks-test-producer");
    case 1: return WORD("Fringeworks");
    case 2: case 5: case 6: case 7: return WORD("TestProducer");
    case 3: return WORD("1.0");
    case 4: return WORD("Custom");
    case 8: NUMBER(int32_t, INT32, 0);
    case 9: NUMBER(uint32_t, UINT32, 1);
    case 10: NUMBER(uint32_t, UINT32, 5);
    }
    return NOT_AVAILABLE;
}
API GCGetInfo(int32_t what, int32_t *type, void *to, size_t *size) { return system_info(what, type, to, size); }
API GCGetLastError(int32_t *code, char *to, size_t *size) { int32_t *type = NULL; if (code) *code = FAILED; return WORD("error of the test producer"); }
API TLOpen(void **h) { if (!initialized) return NOT_INITIALIZED; if (system_open) return IN_USE; system_open = 1; *h = &system_module; return OK; }
API TLClose(void *h) { if (h != &system_module) return INVALID_HANDLE; system_open = 0; return OK; }
API TLGetInfo(void *h, int32_t what, int32_t *type, void *to, size_t *size) { (void)h; return system_info(what, type, to, size); }
API TLUpdateInterfaceList(void *h, uint8_t *different, uint64_t timeout) { (void)h; (void)timeout; if (different) *different = 1; return OK; }
API TLGetNumInterfaces(void *h, uint32_t *n) { (void)h; *n = 1; return OK; }
API TLGetInterfaceID(void *h, uint32_t k, char *to, size_t *size) { (void)h; int32_t *type = NULL; return k ? INVALID_INDEX : WORD("FWIF"); }
static int32_t interface_info(int32_t what, int32_t *type, void *to, size_t *size) {
    return what == 0 ? WORD("FWIF") : what == 1 ? WORD("Interface of the test") : what == 2 ? WORD("Custom") : NOT_AVAILABLE;
}
API TLGetInterfaceInfo(void *h, const char *id, int32_t what, int32_t *type, void *to, size_t *size) { (void)h; (void)id; return interface_info(what, type, to, size); }
API TLOpenInterface(void *h, const char *id, void **to) { (void)h; if (strcmp(id, "FWIF")) return INVALID_ID; *to = &interface_module; return OK; }
API IFClose(void *h) { (void)h; return OK; }
API IFGetInfo(void *h, int32_t what, int32_t *type, void *to, size_t *size) { (void)h; return interface_info(what, type, to, size); }

/* Devices that are unplugged are in no list. */
static Camera *listed(uint32_t k) {
    for (int n = 0; n < CAMERAS && n < (int)control->plugged; n++)
        if (!control->unplugged[n] && !k--) return &cameras[n];
    return NULL;
}
static Camera *named(const char *id) {
    for (uint32_t k = 0; listed(k); k++) if (!strcmp(listed(k)->id, id)) return listed(k);
    return NULL;
}
API IFUpdateDeviceList(void *h, uint8_t *different, uint64_t timeout) { (void)h; (void)timeout; if (different) *different = 1; return OK; }
API IFGetNumDevices(void *h, uint32_t *n) { (void)h; for (*n = 0; listed(*n);) ++*n; return OK; }
API IFGetDeviceID(void *h, uint32_t k, char *to, size_t *size) { (void)h; int32_t *type = NULL; Camera *c = listed(k); return c ? WORD(c->id) : INVALID_INDEX; }
static int32_t device_info(Camera *c, int32_t what, int32_t *type, void *to, size_t *size) {
    switch (what) {
    case 0: case 7: return WORD(c->id);
    case 1: return WORD("Fringeworks");
    case 2: return WORD("Fake");
    case 3: return WORD("Custom");
    case 4: return WORD("Fringeworks Fake");
    case 5: NUMBER(int32_t, INT32, c->open ? 4 : 1);
    case 8: return WORD("1.0");
    case 9: NUMBER(uint64_t, UINT64, 1000000000);
    }
    return NOT_AVAILABLE;
}
API IFGetDeviceInfo(void *h, const char *id, int32_t what, int32_t *type, void *to, size_t *size) { (void)h; Camera *c = named(id); return c ? device_info(c, what, type, to, size) : INVALID_ID; }
API IFOpenDevice(void *h, const char *id, int32_t flags, void **to) {
    (void)h; (void)flags;
    Camera *c = named(id);
    if (!c) return INVALID_ID;
    if (c->open) return DENIED;
    memset(&c->r, 0, sizeof c->r);
    c->r = (Registers){.width = SIDE, .height = SIDE, .format = 0x01080001, .sensor_width = SIDE, .sensor_height = SIDE,
        .exposure_us = 10000, .exposure_auto = 1, .gain_auto = 1, .rate_hz = 50, .ptp_status = 0,
        .vendor = "Fringeworks", .model = "Fake"};
    snprintf(c->r.serial, sizeof c->r.serial, "%s", c->id);
    c->generation = control->generation[c->index];
    c->open = 1; c->dead = 0; c->frame = c->triggers = 0;
    *to = &device_module[c->index];
    return OK;
}
API DevClose(void *h) { Camera *c = device_of(h); if (!c) return INVALID_HANDLE; c->open = 0; return OK; }
API DevGetInfo(void *h, int32_t what, int32_t *type, void *to, size_t *size) { Camera *c = device_of(h); return c ? device_info(c, what, type, to, size) : INVALID_HANDLE; }
API DevGetPort(void *h, void **to) { Camera *c = device_of(h); if (!c) return INVALID_HANDLE; *to = c; return OK; }
API DevGetNumDataStreams(void *h, uint32_t *n) { (void)h; *n = 1; return OK; }
API DevGetDataStreamID(void *h, uint32_t k, char *to, size_t *size) { (void)h; int32_t *type = NULL; return k ? INVALID_INDEX : WORD("Stream0"); }
API DevOpenDataStream(void *h, const char *id, void **to) { (void)id; Camera *c = device_of(h); if (!c) return INVALID_HANDLE; if (gone(c)) return IO; *to = &stream_module[c->index]; return OK; }

/* ---- ports: registers and their description ---- */
static int is_remote(void *h) { return h == &cameras[0] || h == &cameras[1]; }
static int32_t accessed(void *h, uint64_t address, void *buffer, size_t *size, int writes) {
    Camera *c = device_of(h);
    if (!is_remote(h)) return INVALID_ADDRESS;
    if (gone(c)) return IO;
    if (!writes && address >= DESCRIPTION && address + *size <= DESCRIPTION + ((xml_size + 3) & ~3ull)) {
        memset(buffer, 0, *size);
        size_t at = address - DESCRIPTION, left = at < xml_size ? xml_size - at : 0;
        memcpy(buffer, xml + at, left < *size ? left : *size);
        return OK;
    }
    if (address + *size > sizeof c->r) return INVALID_ADDRESS;
    pthread_mutex_lock(&lock);
    c->r.payload = (uint32_t)(c->r.width * c->r.height * bytes_per_pixel(&c->r));
    c->r.ptp_status = c->r.ptp_enable ? (c->index ? 8 : 4) : 0; /* Disabled, Master, Slave */
    c->r.ptp_offset = c->r.ptp_enable && c->index ? (int64_t)control->ptp_offset_ns : 0;
    if (writes) memcpy((char *)&c->r + address, buffer, *size);
    else memcpy(buffer, (char *)&c->r + address, *size);
    if (writes && address == offsetof(Registers, trigger)) { c->triggers += c->r.trigger; c->r.trigger = 0; }
    if (writes && address == offsetof(Registers, stop)) c->r.start = c->r.stop = 0;
    if (writes && address == offsetof(Registers, latch)) { c->r.latched = stamp(c); c->r.latch = 0; }
    pthread_mutex_unlock(&lock);
    return OK;
}
API GCReadPort(void *h, uint64_t address, void *buffer, size_t *size) { return accessed(h, address, buffer, size, 0); }
API GCWritePort(void *h, uint64_t address, const void *buffer, size_t *size) { return accessed(h, address, (void *)buffer, size, 1); }
API GCGetPortInfo(void *h, int32_t what, int32_t *type, void *to, size_t *size) {
    int kind = h == &system_module ? 0 : h == &interface_module ? 1 : 2;
    for (int k = 0; k < CAMERAS; k++) if (h == &stream_module[k]) kind = 3;
    switch (what) {
    case 0: return WORD("port");
    case 1: return WORD("Fringeworks");
    case 2: return WORD("Fake");
    case 3: return WORD("Custom");
    case 4: return WORD(is_remote(h) ? "Device" : KINDS[kind]);
    case 5: case 7: case 8: NUMBER(uint8_t, BOOL8, 1);
    case 6: case 9: case 10: NUMBER(uint8_t, BOOL8, 0);
    case 11: return WORD("1.0");
    case 12: return WORD("Device");
    }
    return NOT_AVAILABLE;
}
API GCGetNumPortURLs(void *h, uint32_t *n) { *n = is_remote(h); return OK; }
API GCGetPortURLInfo(void *h, uint32_t k, int32_t what, int32_t *type, void *to, size_t *size) {
    char url[64];
    if (!is_remote(h) || k) return INVALID_INDEX;
    snprintf(url, sizeof url, "Local:fake.xml;%x;%zx", DESCRIPTION, xml_size);
    switch (what) {
    case 0: return WORD(url);
    case 1: case 3: NUMBER(int32_t, INT32, 1);
    case 2: case 4: case 5: NUMBER(int32_t, INT32, what == 2 ? 1 : 0);
    case 7: NUMBER(uint64_t, UINT64, DESCRIPTION);
    case 8: NUMBER(uint64_t, UINT64, xml_size);
    case 9: NUMBER(int32_t, INT32, 0);
    case 10: return WORD("fake.xml");
    }
    return NOT_AVAILABLE;
}
API GCGetPortURL(void *h, char *to, size_t *size) { int32_t type; return GCGetPortURLInfo(h, 0, 0, &type, to, size); }

/* ---- streams ---- */
API DSGetInfo(void *h, int32_t what, int32_t *type, void *to, size_t *size) {
    Camera *c = device_of(h);
    switch (what) {
    case 0: return WORD("Stream0");
    case 1: NUMBER(uint64_t, UINT64, c->frame);
    case 4: NUMBER(size_t, SIZE, c->n_in);
    case 5: NUMBER(size_t, SIZE, c->n_out);
    case 8: NUMBER(uint8_t, BOOL8, c->streaming);
    case 9: NUMBER(uint8_t, BOOL8, 0);
    case 10: return WORD("Custom");
    case 12: NUMBER(size_t, SIZE, 1);
    case 13: NUMBER(size_t, SIZE, 1);
    }
    return NOT_AVAILABLE;
}
static int32_t announced(void *h, void *base, size_t size, void *user, void **to, int mine) {
    Camera *c = device_of(h);
    for (int k = 0; k < BUFFERS; k++) if (!c->buffers[k].base) {
        c->buffers[k] = (Buffer){.base = base, .size = size, .user = user, .mine = mine};
        *to = &c->buffers[k];
        return OK;
    }
    return FAILED;
}
API DSAnnounceBuffer(void *h, void *base, size_t size, void *user, void **to) { return announced(h, base, size, user, to, 0); }
API DSAllocAndAnnounceBuffer(void *h, size_t size, void *user, void **to) { return announced(h, malloc(size), size, user, to, 1); }
static void taken_out(Buffer **list, int *n, Buffer *b) {
    int kept = 0;
    for (int k = 0; k < *n; k++) if (list[k] != b) list[kept++] = list[k];
    *n = kept;
}
API DSRevokeBuffer(void *h, void *buffer, void **base, void **user) {
    Camera *c = device_of(h); Buffer *b = buffer;
    pthread_mutex_lock(&lock);
    taken_out(c->in, &c->n_in, b); taken_out(c->out, &c->n_out, b);
    pthread_mutex_unlock(&lock);
    if (base) *base = b->mine ? NULL : b->base;
    if (user) *user = b->user;
    if (b->mine) free(b->base);
    b->base = NULL;
    return OK;
}
API DSQueueBuffer(void *h, void *buffer) {
    Camera *c = device_of(h);
    pthread_mutex_lock(&lock);
    c->in[c->n_in++] = buffer;
    pthread_mutex_unlock(&lock);
    return OK;
}
API DSFlushQueue(void *h, int32_t how) {
    Camera *c = device_of(h);
    pthread_mutex_lock(&lock);
    if (how == 1 || how == 4) c->n_out = 0;
    if (how == 4) c->n_in = 0;
    if (how == 2 || how == 3) {
        c->n_in = 0;
        if (how == 2) c->n_out = 0;
        for (int k = 0; k < BUFFERS; k++) if (c->buffers[k].base) c->in[c->n_in++] = &c->buffers[k];
    }
    pthread_mutex_unlock(&lock);
    return OK;
}
API DSStartAcquisition(void *h, int32_t flags, uint64_t n) {
    (void)flags; (void)n;
    Camera *c = device_of(h);
    if (gone(c)) return IO;
    if (c->streaming) return IN_USE;
    c->streaming = c->running = 1;
    return pthread_create(&c->thread, NULL, run, c) ? FAILED : OK;
}
static void ended(Camera *c) {
    pthread_mutex_lock(&lock); c->streaming = 0; pthread_cond_broadcast(&changed); pthread_mutex_unlock(&lock);
    if (c->running) pthread_join(c->thread, NULL);
    c->running = 0;
}
API DSStopAcquisition(void *h, int32_t flags) { (void)flags; ended(device_of(h)); return OK; }
API DSClose(void *h) { Camera *c = device_of(h); ended(c); c->n_in = c->n_out = 0; return OK; }
API DSGetBufferID(void *h, uint32_t k, void **to) { Camera *c = device_of(h); if (k >= BUFFERS || !c->buffers[k].base) return INVALID_INDEX; *to = &c->buffers[k]; return OK; }
API DSGetBufferInfo(void *h, void *buffer, int32_t what, int32_t *type, void *to, size_t *size) {
    (void)h;
    Buffer *b = buffer;
    switch (what) {
    case 0: NUMBER(void *, PTR, b->base);
    case 1: NUMBER(size_t, SIZE, b->size);
    case 2: NUMBER(void *, PTR, b->user);
    case 3: case 28: NUMBER(uint64_t, UINT64, b->stamp);
    case 4: NUMBER(uint8_t, BOOL8, 1);
    case 5: case 6: NUMBER(uint8_t, BOOL8, 0);
    case 7: NUMBER(uint8_t, BOOL8, b->incomplete);
    case 8: return WORD("Custom");
    case 9: case 27: NUMBER(size_t, SIZE, b->filled);
    case 10: NUMBER(size_t, SIZE, b->width);
    case 11: case 22: NUMBER(size_t, SIZE, b->height);
    case 12: case 13: case 14: case 15: case 18: NUMBER(size_t, SIZE, 0);
    case 16: NUMBER(uint64_t, UINT64, b->id);
    case 17: NUMBER(uint8_t, BOOL8, 1);
    case 19: NUMBER(size_t, SIZE, 1);
    case 20: NUMBER(uint64_t, UINT64, b->format);
    case 21: NUMBER(uint64_t, UINT64, 5);
    case 26: NUMBER(int32_t, INT32, 1);
    }
    return NOT_AVAILABLE;
}

/* ---- events: new buffers only; the handle of the event is the stream's ---- */
static int killed[CAMERAS];
API GCRegisterEvent(void *h, int32_t what, void **to) { Camera *c = device_of(h); if (what != 1 || !c || is_remote(h)) return NOT_IMPLEMENTED; killed[c->index] = 0; *to = h; return OK; }
API GCUnregisterEvent(void *h, int32_t what) { (void)h; (void)what; return OK; }
API EventKill(void *h) { Camera *c = device_of(h); pthread_mutex_lock(&lock); killed[c->index] = 1; pthread_cond_broadcast(&changed); pthread_mutex_unlock(&lock); return OK; }
API EventFlush(void *h) { Camera *c = device_of(h); pthread_mutex_lock(&lock); c->n_out = 0; pthread_mutex_unlock(&lock); return OK; }
API EventGetInfo(void *h, int32_t what, int32_t *type, void *to, size_t *size) {
    Camera *c = device_of(h);
    switch (what) {
    case 0: NUMBER(int32_t, INT32, 1);
    case 1: NUMBER(size_t, SIZE, c->n_out);
    case 2: NUMBER(uint64_t, UINT64, c->frame);
    case 3: NUMBER(size_t, SIZE, 2 * sizeof(void *));
    case 4: NUMBER(size_t, SIZE, sizeof(void *));
    }
    return NOT_AVAILABLE;
}
API EventGetData(void *h, void *to, size_t *size, uint64_t timeout_ms) {
    Camera *c = device_of(h);
    uint64_t end = now_ns(CLOCK_MONOTONIC) + 1000000ull * (timeout_ms > 3600000 ? 3600000 : timeout_ms);
    struct timespec until = {(time_t)(end / 1000000000), (long)(end % 1000000000)};
    int32_t code = OK;
    pthread_mutex_lock(&lock);
    while (!c->n_out && code == OK) {
        if (killed[c->index]) { killed[c->index] = 0; code = ABORT; break; }
        if (pthread_cond_timedwait(&changed, &lock, &until)) code = c->n_out ? OK : TIMEOUT;
    }
    if (code == OK) {
        Buffer *b = c->out[0];
        memmove(c->out, c->out + 1, --c->n_out * sizeof *c->out);
        ((void **)to)[0] = b; ((void **)to)[1] = b->user;
        *size = 2 * sizeof(void *);
    }
    pthread_mutex_unlock(&lock);
    return code;
}
API EventGetDataInfo(void *h, const void *in, size_t n, int32_t what, int32_t *type, void *to, size_t *size) {
    (void)h; (void)n;
    if (what == 0 || what == 1) NUMBER(void *, PTR, ((void *const *)in)[what]);
    return NOT_AVAILABLE;
}

/* ---- what this producer has not ---- */
#define NONE(name) API name(void) { return NOT_IMPLEMENTED; }
NONE(DSGetBufferChunkData) NONE(GCReadPortStacked) NONE(GCWritePortStacked) NONE(IFGetParentTL) NONE(DevGetParentIF)
NONE(DSGetParentDev) NONE(DSGetNumBufferParts) NONE(DSGetBufferPartInfo) NONE(DSAnnounceCompositeBuffer)
NONE(DSGetBufferInfoStacked) NONE(DSGetBufferPartInfoStacked) NONE(DSGetNumFlows) NONE(DSGetFlowInfo)
NONE(DSGetNumBufferSegments) NONE(DSGetBufferSegmentInfo)
