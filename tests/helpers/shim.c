/* A library to preload. It lets the k-th operation on paths under one folder fail, kills the process at it, or
   records the operations. Set SHIM_FOLDER, SHIM_AT, SHIM_MODE and SHIM_LOG before the program starts, or call
   shim_arm in the program.

   Modes: ENOSPC, EIO (the operation fails), full (it and all later writes and creations fail with ENOSPC),
   before, after (the process is killed there), half (half of a write is done, then it is killed), SIGINT, SIGTERM,
   SIGHUP, SIGSTOP (the process gets that signal before the operation), none (operations are only recorded).
   A record is a line "operation path", or "rename source path", which is written after the operation; it begins
   with "-" if the system refused. With SHIM_NO_EXCHANGE set, two paths cannot be exchanged. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

static char folder[PATH_MAX], mode[16] = "none";
static long at, count;
static int record = -1;

void shim_arm(const char *where, long k, const char *how, const char *log) {
    snprintf(mode, sizeof mode, "%s", how);
    at = k, count = 0;
    if (log && *log) record = syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    snprintf(folder, sizeof folder, "%s", where);
}

__attribute__((constructor)) static void begin(void) {
    const char *where = getenv("SHIM_FOLDER"), *k = getenv("SHIM_AT"), *how = getenv("SHIM_MODE");
    if (where) shim_arm(where, k ? atol(k) : 0, how ? how : "none", getenv("SHIM_LOG"));
}

static int watched(const char *path) {
    size_t n = strlen(folder);
    return n && !strncmp(path, folder, n) && (path[n] == '/' || !path[n]);
}

static void of_descriptor(int fd, char *out) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, out, PATH_MAX - 1);
    out[n < 0 ? 0 : n] = 0;
}

static void of_name(int base, const char *path, char *out) {
    char start[PATH_MAX];
    if (path[0] == '/') {
        snprintf(out, PATH_MAX, "%s", path);
        return;
    }
    if (base != AT_FDCWD) of_descriptor(base, start);
    else if (!getcwd(start, sizeof start)) start[0] = 0;
    size_t n = strlen(start);
    memcpy(out, start, n);
    snprintf(out + n, PATH_MAX - n, "/%s", path);
}

static void die(void) {
    syscall(SYS_kill, getpid(), SIGKILL);
    for (;;) pause();
}

static int number(const char *name) {
    if (!strcmp(name, "SIGINT")) return SIGINT;
    if (!strcmp(name, "SIGTERM")) return SIGTERM;
    if (!strcmp(name, "SIGHUP")) return SIGHUP;
    return strcmp(name, "SIGSTOP") ? 0 : SIGSTOP;
}

/* Whether the operation is to be done; its number if it is the chosen one. */
static int decide(const char *path, int creates, long *k) {
    *k = 0;
    if (!watched(path)) return 1;
    long mine = __sync_add_and_fetch(&count, 1);
    if (mine == at) *k = mine;
    if (!strcmp(mode, "full") && at && mine >= at && creates) return errno = ENOSPC, 0;
    if (mine != at) return 1;
    if (!strcmp(mode, "before")) die();
    if (!strcmp(mode, "ENOSPC")) return errno = ENOSPC, 0;
    if (!strcmp(mode, "EIO")) return errno = EIO, 0;
    if (number(mode)) syscall(SYS_kill, getpid(), number(mode));
    return 1;
}

static void done(int good, long k, const char *operation, const char *source, const char *path) {
    int kept = errno;
    if (record >= 0 && watched(path)) {
        char line[2 * PATH_MAX + 32];
        int n = snprintf(line, sizeof line, "%s%s%s%s %s\n", good ? "" : "-", operation, *source ? " " : "", source, path);
        if (syscall(SYS_write, record, line, n) != n) die();
    }
    if (k && !strcmp(mode, "after")) die();
    errno = kept;
}

#define GUARD(operation, source, path, creates, call) \
    long k; if (!decide(path, creates, &k)) return -1; \
    long result = call; done(result >= 0, k, operation, source, path); return result

ssize_t write(int fd, const void *data, size_t n) {
    char path[PATH_MAX];
    of_descriptor(fd, path);
    long k;
    if (!decide(path, 1, &k)) return -1;
    if (k && !strcmp(mode, "half")) {
        syscall(SYS_write, fd, data, n / 2);
        die();
    }
    ssize_t result = syscall(SYS_write, fd, data, n);
    done(result >= 0, k, "write", "", path);
    return result;
}

ssize_t pwrite64(int fd, const void *data, size_t n, off_t offset) {
    char path[PATH_MAX];
    of_descriptor(fd, path);
    GUARD("write", "", path, 1, syscall(SYS_pwrite64, fd, data, n, offset));
}
ssize_t pwrite(int fd, const void *data, size_t n, off_t offset) { return pwrite64(fd, data, n, offset); }

ssize_t writev(int fd, const struct iovec *parts, int n) {
    char path[PATH_MAX];
    of_descriptor(fd, path);
    GUARD("write", "", path, 1, syscall(SYS_writev, fd, parts, n));
}

int fsync(int fd) {
    char path[PATH_MAX];
    of_descriptor(fd, path);
    GUARD("fsync", "", path, 0, syscall(SYS_fsync, fd));
}
int fdatasync(int fd) { return fsync(fd); }

int renameat2(int from, const char *source, int to, const char *target, unsigned flags) {
    char old[PATH_MAX], new[PATH_MAX];
    of_name(from, source, old), of_name(to, target, new);
    if (flags && getenv("SHIM_NO_EXCHANGE") && watched(new)) return errno = EINVAL, -1;
    GUARD("rename", old, new, 0, syscall(SYS_renameat2, from, source, to, target, flags));
}
int renameat(int from, const char *source, int to, const char *target) {
    return renameat2(from, source, to, target, 0);
}
int rename(const char *source, const char *target) {
    return renameat2(AT_FDCWD, source, AT_FDCWD, target, 0);
}

int unlinkat(int base, const char *name, int flags) {
    char path[PATH_MAX];
    of_name(base, name, path);
    GUARD(flags & AT_REMOVEDIR ? "rmdir" : "unlink", "", path, 0, syscall(SYS_unlinkat, base, name, flags));
}
int unlink(const char *name) { return unlinkat(AT_FDCWD, name, 0); }
int rmdir(const char *name) { return unlinkat(AT_FDCWD, name, AT_REMOVEDIR); }

int mkdirat(int base, const char *name, mode_t bits) {
    char path[PATH_MAX];
    of_name(base, name, path);
    GUARD("mkdir", "", path, 1, syscall(SYS_mkdirat, base, name, bits));
}
int mkdir(const char *name, mode_t bits) { return mkdirat(AT_FDCWD, name, bits); }

static int opened(int base, const char *name, int flags, mode_t bits) {
    char path[PATH_MAX];
    if (!(flags & O_CREAT)) return syscall(SYS_openat, base, name, flags, bits);
    of_name(base, name, path);
    GUARD("create", "", path, 1, syscall(SYS_openat, base, name, flags, bits));
}
#define OPEN(name, base, base_value) \
    int name(base const char *path, int flags, ...) { \
        va_list more; va_start(more, flags); mode_t bits = va_arg(more, mode_t); va_end(more); \
        return opened(base_value, path, flags, bits); }
#define AT int directory,
OPEN(open, , AT_FDCWD)
OPEN(open64, , AT_FDCWD)
OPEN(openat, AT, directory)
OPEN(openat64, AT, directory)
