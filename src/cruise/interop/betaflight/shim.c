/* Flies a Betaflight SITL process in lock-step: preloaded, the firmware itself untouched.
 *
 * CRUISE_FD    socket (SOCK_SEQPACKET) to the host. Without it this file does nothing.
 * CRUISE_UART  if set, UART1 listens on a free port of the loopback; otherwise no port is opened at all.
 *
 * The clock is virtual: it goes on with every look and every sleep, as far as the host has granted. There the firmware
 * stops, tells what its motors were told, and takes what comes next: state and sticks, as if they had come by UDP, and
 * more time. Its threads are coroutines that run one after the other on the main thread, so that every flight is the
 * same bit for bit, and so that a process can be forked in the middle of one.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dlfcn.h>
#include <errno.h>
#include <netinet/in.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <time.h>
#include <ucontext.h>
#include <unistd.h>

#define LOOK_NS 500u       /* that a look at the clock takes */
#define SLEEP_SHARE 5      /* of a sleep that passes: it makes room for other processes, and there are none */
#define STACK (256 * 1024) /* bytes, of a coroutine */
#define STATE_PORT 9003
#define RC_PORT 9004
#define MOTORS_PORT 9001
#define GAZEBO_PORT 9002
#define UART1_PORT 5761

enum { RUN = 0, FORK = 1 };

typedef struct {
    uint64_t run_ns;
    uint8_t what, has_state, has_rc, pad[5];
    uint8_t state[144];
    uint8_t rc[40];
} from_host;

typedef struct {
    uint64_t now_ns;
    uint32_t sent, pid, uart_port, pad;
    uint8_t motors[68];
    uint32_t pad2;
} to_host;

typedef struct {
    int fd;
    const uint8_t *data;
    size_t size; /* 0: nothing there */
} mailbox;

typedef struct {
    ucontext_t context;
    void *(*start)(void *);
    void *argument;
    mailbox *waits_for; /* NULL: for anything else */
} coroutine;

static int host = -1;
static uint64_t now_ns, limit_ns;
static to_host out;
static from_host in;
static mailbox state_box = {-1, NULL, 0}, rc_box = {-1, NULL, 0};
static coroutine coroutines[8], *running;
static int number_of_coroutines;
static ucontext_t main_context;

#define REAL(name) ((__typeof__(name) *)dlsym(RTLD_NEXT, #name))

__attribute__((constructor)) static void start(void)
{
    const char *fd = getenv("CRUISE_FD");
    if (fd) host = atoi(fd);
    signal(SIGCHLD, SIG_IGN); /* forked processes belong to nobody */
}

static void resume(coroutine *one)
{
    running = one;
    swapcontext(&main_context, &one->context);
    running = NULL;
}

static void run_coroutine(void)
{
    running->start(running->argument);
    for (;;) swapcontext(&running->context, &main_context);
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*start)(void *), void *argument)
{
    if (host < 0) return REAL(pthread_create)(thread, attributes, start, argument);
    if (number_of_coroutines == 8) return EAGAIN;
    coroutine *one = &coroutines[number_of_coroutines++];
    getcontext(&one->context);
    one->context.uc_stack.ss_sp = malloc(STACK);
    one->context.uc_stack.ss_size = STACK;
    one->context.uc_link = NULL;
    one->start = start;
    one->argument = argument;
    makecontext(&one->context, run_coroutine, 0);
    *thread = pthread_self();
    resume(one); /* until it waits for the first time */
    return 0;
}

int pthread_join(pthread_t thread, void **result)
{
    return host < 0 ? REAL(pthread_join)(thread, result) : 0;
}

/* To whoever waits for this mailbox; before anybody does it is lost, as a packet would be. */
static void deliver(mailbox *box, const uint8_t *data, size_t size)
{
    for (int i = 0; i < number_of_coroutines; i++)
        if (box->fd >= 0 && coroutines[i].waits_for == box) {
            box->data = data;
            box->size = size;
            resume(&coroutines[i]);
            return;
        }
}

static void look_at_ports(void)
{
    for (int i = 0; i < number_of_coroutines; i++)
        if (!coroutines[i].waits_for) resume(&coroutines[i]);
}

static ssize_t receive(int *passed_fd)
{
    char room[CMSG_SPACE(sizeof(int))];
    struct iovec part = {&in, sizeof in};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1, .msg_control = room, .msg_controllen = sizeof room};
    ssize_t n = recvmsg(host, &message, 0);
    struct cmsghdr *extra = n > 0 ? CMSG_FIRSTHDR(&message) : NULL;
    *passed_fd = -1;
    if (extra) memcpy(passed_fd, CMSG_DATA(extra), sizeof(int));
    return n;
}

static void meet_host(void)
{
    while (now_ns >= limit_ns) {
        int fd;
        out.now_ns = now_ns;
        out.pid = (uint32_t)getpid();
        if (send(host, &out, sizeof out, MSG_NOSIGNAL) != sizeof out) _exit(0);
        out.sent = 0;
        if (receive(&fd) != sizeof in) _exit(0); /* the host is gone */
        if (in.what == FORK) {
            if (fork() == 0) {
                close(host);
                host = fd;
            } else if (fd >= 0)
                close(fd);
            continue;
        }
        if (in.has_state) deliver(&state_box, in.state, sizeof in.state);
        if (in.has_rc) deliver(&rc_box, in.rc, sizeof in.rc);
        if (out.uart_port) look_at_ports();
        limit_ns += in.run_ns;
    }
}

int clock_gettime(clockid_t id, struct timespec *time)
{
    if (host < 0 || id != CLOCK_MONOTONIC) return REAL(clock_gettime)(id, time);
    if (!running) {
        now_ns += LOOK_NS;
        if (now_ns >= limit_ns) meet_host();
    }
    time->tv_sec = (time_t)(now_ns / 1000000000u);
    time->tv_nsec = (long)(now_ns % 1000000000u);
    return 0;
}

int nanosleep(const struct timespec *asked, struct timespec *left)
{
    if (host < 0) return REAL(nanosleep)(asked, left);
    now_ns += ((uint64_t)asked->tv_sec * 1000000000u + (uint64_t)asked->tv_nsec) / SLEEP_SHARE;
    if (!running && now_ns >= limit_ns) meet_host();
    return 0;
}

static int bind_uart(int fd, struct sockaddr_in address)
{
    socklen_t size = sizeof address;
    if (!getenv("CRUISE_UART") || ntohs(address.sin_port) != UART1_PORT) {
        errno = EADDRNOTAVAIL;
        return -1;
    }
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = 0;
    if (REAL(bind)(fd, (struct sockaddr *)&address, sizeof address)) return -1;
    getsockname(fd, (struct sockaddr *)&address, &size);
    out.uart_port = ntohs(address.sin_port);
    return 0;
}

int bind(int fd, const struct sockaddr *address, socklen_t size)
{
    if (host < 0) return REAL(bind)(fd, address, size);
    if (address->sa_family != AF_INET) {
        errno = EAFNOSUPPORT;
        return -1;
    }
    struct sockaddr_in ours;
    int type = 0;
    socklen_t length = sizeof type;
    memcpy(&ours, address, sizeof ours);
    getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length);
    if (type != SOCK_DGRAM) return bind_uart(fd, ours);
    if (ntohs(ours.sin_port) == STATE_PORT) state_box.fd = fd;
    if (ntohs(ours.sin_port) == RC_PORT) rc_box.fd = fd;
    return 0; /* nothing comes by UDP */
}

static mailbox *box_of(int fd)
{
    return host < 0 || fd < 0 ? NULL : fd == state_box.fd ? &state_box : fd == rc_box.fd ? &rc_box : NULL;
}

int select(int n, fd_set *reading, fd_set *writing, fd_set *failing, struct timeval *wait)
{
    struct timeval none = {0, 0};
    coroutine *me = running;
    if (host < 0 || !me) return REAL(select)(n, reading, writing, failing, wait);
    mailbox *box = box_of(n - 1);
    me->waits_for = box;
    swapcontext(&me->context, &main_context);
    return box ? box->size > 0 : REAL(select)(n, reading, writing, failing, &none);
}

ssize_t recvfrom(int fd, void *buffer, size_t size, int flags, struct sockaddr *address, socklen_t *length)
{
    mailbox *box = box_of(fd);
    if (!box) return REAL(recvfrom)(fd, buffer, size, flags, address, length);
    size_t n = box->size < size ? box->size : size;
    memcpy(buffer, box->data, n);
    box->size = 0;
    return (ssize_t)n;
}

ssize_t sendto(int fd, const void *data, size_t size, int flags, const struct sockaddr *address, socklen_t length)
{
    int port = host >= 0 && address && address->sa_family == AF_INET
        ? ntohs(((const struct sockaddr_in *)address)->sin_port) : 0;
    if (port != MOTORS_PORT && port != GAZEBO_PORT) return REAL(sendto)(fd, data, size, flags, address, length);
    if (port == MOTORS_PORT) {
        memcpy(out.motors, data, size < sizeof out.motors ? size : sizeof out.motors);
        out.sent++;
    }
    return (ssize_t)size;
}
