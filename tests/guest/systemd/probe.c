/* Tries what a daemon under captured.service must not be able to do, and what it must, one line each:
 * NAME, a tab, and "done" or the error's name. The same program outside the sandbox shows that each
 * attempt can succeed at all. What lies at the paths is laid by drivers/tests/kernel/unit.rs. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/netlink.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/personality.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/swap.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/timex.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static void tell(const char *name, int failed)
{
	printf("%s\t%s\n", name, failed ? strerrorname_np(errno) : "done");
	fflush(stdout);
}

static int opens(const char *path, int flags)
{
	int file = open(path, flags | O_CLOEXEC, 0600);

	if (file >= 0)
		close(file);
	return file < 0;
}

static int has_socket(int family, int type, int protocol)
{
	int file = socket(family, type | SOCK_CLOEXEC, protocol);

	if (file >= 0)
		close(file);
	return file < 0;
}

/* Writes what is there already, so that outside the sandbox nothing changes. */
static int rewrites(const char *path)
{
	char text[4096];
	int file = open(path, O_RDWR | O_CLOEXEC);
	ssize_t length, written;

	if (file < 0)
		return 1;
	length = read(file, text, sizeof(text));
	written = length < 0 ? -1 : pwrite(file, text, length, 0);
	close(file);
	return written < 0;
}

static int ends_by_itself(int (*act)(void))
{
	int status = 0;
	pid_t child = fork();

	if (child < 0)
		return 1;
	if (child == 0)
		_exit(act() ? errno : 0);
	waitpid(child, &status, 0);
	errno = WIFSIGNALED(status) ? EPERM : WEXITSTATUS(status);
	return errno != 0;
}

static int is_traced(void) { return ptrace(PTRACE_TRACEME, 0, 0, 0) != 0; }
static int is_real_time(void)
{
	struct sched_param wanted = { .sched_priority = 1 };

	return sched_setscheduler(0, SCHED_FIFO, &wanted);
}
static int is_root_again(void) { return setuid(0); }
static int has_users_of_its_own(void) { return unshare(CLONE_NEWUSER); }
static int has_mounts_of_its_own(void) { return unshare(CLONE_NEWNS); }
static int is_another_machine(void) { return personality(PER_LINUX32) == -1; }
static int asks_the_old_way(void)
{
	long answer = -ENOSYS;
#ifdef __x86_64__
	/* getpid of the 32-bit world. */
	__asm__ volatile("int $0x80" : "=a"(answer) : "a"(20) : "memory");
#endif
	errno = answer < 0 ? (int)-answer : 0;
	return answer < 0;
}
/* A copy of this program that belongs to root and is set-uid. */
static int is_lifted(void)
{
	int status = 0;
	pid_t child = fork();

	if (child == 0) {
		execl("/usr/bin/probe-of-root", "probe", "whoami", NULL);
		_exit(100);
	}
	waitpid(child, &status, 0);
	errno = WEXITSTATUS(status) == 0 ? 0 : EPERM;
	return errno != 0;
}
static int is_many(void)
{
	int made = 0, failed = 0;

	/* Its children are ended as a group. */
	setpgid(0, 0);
	for (; made < 200; made++) {
		pid_t child = fork();

		if (child < 0) {
			failed = errno;
			break;
		}
		if (child == 0) {
			pause();
			_exit(0);
		}
	}
	signal(SIGTERM, SIG_IGN);
	kill(0, SIGTERM);
	while (wait(NULL) > 0)
		;
	errno = failed;
	return failed != 0;
}

int main(int count, char **words)
{
	struct timespec now;
	struct timex clock = { 0 };
	struct rlimit most = { 1 << 20, 1 << 20 };
	char own[200], name[65] = "";
	const char *state = getenv("STATE_DIRECTORY");
	void *page;

	if (count > 1 && !strcmp(words[1], "whoami"))
		return geteuid() != 0;

	/* The network. */
	tell("internet socket", has_socket(AF_INET, SOCK_STREAM, 0));
	tell("internet socket, version 6", has_socket(AF_INET6, SOCK_DGRAM, 0));
	tell("packet socket", has_socket(AF_PACKET, SOCK_RAW, 0));
	tell("Unix socket", has_socket(AF_UNIX, SOCK_STREAM, 0));
	tell("kernel uevents", has_socket(AF_NETLINK, SOCK_RAW, NETLINK_KOBJECT_UEVENT));
	/* Files. Everybody may write to /opt/open, and read /home/somebody. */
	tell("file in /opt/open", opens("/opt/open/probe", O_WRONLY | O_CREAT));
	tell("file in /usr/bin", opens("/usr/bin/probe-was-here", O_WRONLY | O_CREAT));
	tell("file in /home", opens("/home/somebody/letter", O_RDONLY));
	tell("file in everybody's /tmp", opens("/tmp/of-everybody", O_RDONLY));
	snprintf(own, sizeof(own), "%s/probe", state ? state : "/tmp");
	tell("file in its own state", opens(own, O_WRONLY | O_CREAT));
	tell("set-uid bit", chmod(own, 04755));
	chmod(own, 0600);
	/* Memory. */
	page = mmap(NULL, 4096, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
	tell("memory to write and run", page == MAP_FAILED);
	page = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
	tell("written memory made to run", mprotect(page, 4096, PROT_READ | PROT_EXEC));
	/* Devices. Everybody may open /dev/ttyS1 and /dev/video0. */
	snprintf(own, sizeof(own), "%s/node", state ? state : "/tmp");
	tell("new device node", mknod(own, S_IFCHR | 0600, makedev(1, 1)));
	unlink(own);
	tell("serial port", opens("/dev/ttyS1", O_RDWR | O_NONBLOCK | O_NOCTTY));
	tell("the kernel's memory", opens("/dev/mem", O_RDONLY));
	tell("the kernel's log device", opens("/dev/kmsg", O_RDONLY | O_NONBLOCK));
	tell("camera", opens("/dev/video0", O_RDWR));
	tell("noise", opens("/dev/urandom", O_RDONLY));
	/* The kernel. Everybody may write the setting in /sys, and the group video the lamp. */
	tell("kernel setting in /sys", rewrites("/sys/kernel/mm/ksm/pages_to_scan"));
	tell("kernel setting in /proc", rewrites("/proc/sys/vm/swappiness"));
	tell("control group", mkdir("/sys/fs/cgroup/probe", 0700));
	rmdir("/sys/fs/cgroup/probe");
	tell("kernel log", syscall(SYS_syslog, 10, NULL, 0) < 0);
	tell("kernel module", syscall(SYS_init_module, "", 0, "") && errno != ENOEXEC);
	tell("brightness of the lamp", rewrites("/sys/class/leds/white:flash/brightness"));
	/* Identity. */
	tell("user root", ends_by_itself(is_root_again));
	tell("set-uid program", is_lifted());
	tell("users of its own", ends_by_itself(has_users_of_its_own));
	tell("mounts of its own", ends_by_itself(has_mounts_of_its_own));
	tell("another machine's calls", ends_by_itself(is_another_machine));
	tell("calls of 32 bits", ends_by_itself(asks_the_old_way));
	/* The machine. */
	clock_gettime(CLOCK_REALTIME, &now);
	tell("date", clock_settime(CLOCK_REALTIME, &now));
	clock.modes = ADJ_FREQUENCY;
	tell("speed of the clock", adjtimex(&clock) < 0);
	gethostname(name, sizeof(name) - 1);
	tell("name of the machine", sethostname(name, strlen(name)));
	tell("mount", mount("none", "/opt/open", "tmpfs", 0, NULL));
	umount("/opt/open");
	tell("swap", swapoff("/opt/open/no-swap") && errno != ENOENT && errno != EINVAL);
	/* Other processes, and more than its share. */
	tell("another process in /proc", opens("/proc/1/stat", O_RDONLY));
	tell("signal to another process", kill(1, 0));
	tell("being traced", ends_by_itself(is_traced));
	tell("real-time priority", ends_by_itself(is_real_time));
	tell("higher limits", setrlimit(RLIMIT_NOFILE, &most));
	tell("two hundred processes", ends_by_itself(is_many));
	return 0;
}
