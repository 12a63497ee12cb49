/* Preloaded by faulty_disk.py: counts the writes, syncs, truncations, renames and removals of files in one folder, and lets one of them
   fail or ends the process there. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

enum { NOTHING, KILL, HALF, FAIL_IO, FAIL_FULL };
static char folder[4096];
static int how = NOTHING, at = -1, seen = 0;

void fault_arm(const char *place, int number, int kind) {
    strncpy(folder, place, sizeof folder - 1);
    at = number; how = kind; seen = 0;
}

int fault_seen(void) { return seen; }

static int ours(const char *path) { return *folder && strncmp(path, folder, strlen(folder)) == 0; }

static int ours_by_number(int fd) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n <= 0) return 0;
    path[n] = 0;
    return ours(path);
}

/* 1 if this call has to fail; errors stay from then on, as those of a disk do */
static int due(void) {
    int number = seen++;
    if (how == NOTHING || number < at) return 0;
    if (how == KILL) kill(getpid(), SIGKILL);
    if (how == HALF) return 1;
    errno = how == FAIL_FULL ? ENOSPC : EIO;
    return 1;
}

#define REAL(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

#define WRITING(name, kind)                                                        \
    ssize_t name(int fd, const void *data, size_t count, kind where) {             \
        REAL(name);                                                                \
        if (ours_by_number(fd) && due()) {                                         \
            if (how != HALF) return -1;                                            \
            (void)!real(fd, data, count / 2, where); /* a page torn by power off */ \
            kill(getpid(), SIGKILL);                                               \
        }                                                                          \
        return real(fd, data, count, where);                                       \
    }
WRITING(pwrite, off_t)
WRITING(pwrite64, off64_t)

ssize_t write(int fd, const void *data, size_t count) {
    REAL(write);
    if (ours_by_number(fd) && due()) {
        if (how != HALF) return -1;
        (void)!real(fd, data, count / 2);
        kill(getpid(), SIGKILL);
    }
    return real(fd, data, count);
}

#define ON_NUMBER(name)                                     \
    int name(int fd) {                                      \
        REAL(name);                                         \
        if (ours_by_number(fd) && due()) {                  \
            if (how == HALF) kill(getpid(), SIGKILL);       \
            return -1;                                      \
        }                                                   \
        return real(fd);                                    \
    }
ON_NUMBER(fsync)
ON_NUMBER(fdatasync)

int ftruncate64(int fd, off64_t length) {
    REAL(ftruncate64);
    if (ours_by_number(fd) && due()) {
        if (how == HALF) kill(getpid(), SIGKILL);
        return -1;
    }
    return real(fd, length);
}

int ftruncate(int fd, off_t length) {
    REAL(ftruncate);
    if (ours_by_number(fd) && due()) {
        if (how == HALF) kill(getpid(), SIGKILL);
        return -1;
    }
    return real(fd, length);
}

int rename(const char *from, const char *to) {
    REAL(rename);
    if ((ours(from) || ours(to)) && due()) {
        if (how == HALF) kill(getpid(), SIGKILL);
        return -1;
    }
    return real(from, to);
}

int unlink(const char *path) {
    REAL(unlink);
    if (ours(path) && due()) {
        if (how == HALF) kill(getpid(), SIGKILL);
        return -1;
    }
    return real(path);
}
