// A USB camera in user space: USB Video Class 1.0 with a bulk endpoint, on GadgetFS over dummy_hcd, so that
// the kernel's own uvcvideo drives it. It photographs a small scene: each row of 16 blocks is brighter to the
// right, and its flash (brightness above 128) lights the middle of the picture more than the rim. Light is
// multiplied by the exposure time and cut at white, so that metering has something to meter.
//
// Formats: YUY2 640x480, MJPEG 640x480 (the files given by -j and, with flash, -f), Z16 depth 320x240.
// Usage: uvcg [-r FPS] [-j FILE] [-f FILE] [-e STEPS] [-i VENDOR:PRODUCT] [-m MODE], MODE being what is wrong with its pictures:
// size (a JPEG of another size), garbage (no JPEG), short (half a picture), huge (a descriptor that
// claims 65535x65535 pixels). Ending it pulls the plug.
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <poll.h>
#include <linux/usb/gadgetfs.h>
#include <math.h>
#define LE16(x) ((x) & 255), ((x) >> 8 & 255)
#define LE32(x) LE16((uint32_t)(x)), LE16((uint32_t)(x) >> 16)
#define IVL 666666
#define UNC(idx, g0, g1, g2, g3) 27, 0x24, 4, idx, 1, g0, g1, g2, g3, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71, 16, 1, 0, 0, 0, 0
#define FRM(sub, w, h, sz) 30, 0x24, sub, 1, 0, LE16(w), LE16(h), LE32((sz) * 8 * 15), LE32((sz) * 8 * 15), LE32(sz), LE32(IVL), 1, LE32(IVL)
static uint8_t body[] = {
	9, 4, 0, 0, 0, 0x0e, 1, 0, 0,
	13, 0x24, 1, LE16(0x0100), LE16(13 + 18 + 11 + 9), LE32(48000000), 1, 1,
	18, 0x24, 2, 1, LE16(0x0201), 0, 0, 0, 0, 0, 0, 0, 0, 3, 0x0a, 0, 0,
	11, 0x24, 5, 2, 1, 0, 0, 2, 0x01, 0x00, 0,
	9, 0x24, 3, 3, LE16(0x0101), 0, 2, 0,
	9, 4, 1, 0, 1, 0x0e, 2, 0, 0,
	16, 0x24, 1, 3, LE16(16 + 57 + 41 + 57), 0x81, 0, 3, 0, 0, 0, 1, 0, 0, 0,
	UNC(1, 'Y', 'U', 'Y', '2'), FRM(5, 640, 480, 614400),
	11, 0x24, 6, 2, 1, 1, 1, 0, 0, 0, 0, FRM(7, 640, 480, 614400),
	UNC(3, 'Z', '1', '6', ' '), FRM(5, 320, 240, 153600),
};
static uint8_t dev_desc[] = { 18, 1, LE16(0x0200), 0, 0, 0, 64, LE16(0x1d6b), LE16(0x0102), LE16(1), 1, 2, 0, 1 };
static uint8_t cur[26]; static volatile int streaming; static int bright = 128, ep0, fps = 15, ae = 8; static uint32_t exposure = 100;
static size_t jlen, flen; static uint8_t *jpg, *fjpg; static const char *mode = "";
/* sRGB-encoded luma of a scene under this exposure (100 us steps), limited range. */
static void scene(uint8_t *fr) {
	for (int y = 0; y < 480; y += 30) for (int x = 0; x < 640; x += 40) {
		double dx = (x - 300) / 320.0, dy = (y - 225) / 240.0;
		double light = 0.02 + 0.1 * x / 640 + (bright > 128 ? 0.5 / (1 + 2 * (dx * dx + dy * dy)) : 0);
		double v = light * exposure / 100; if (v > 1) v = 1;
		v = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
		uint8_t luma = 16 + lrint(219 * v);
		for (int r = 0; r < 30; r++) for (int c = 0; c < 40; c++) { fr[((y + r) * 640 + x + c) * 2] = luma; fr[((y + r) * 640 + x + c) * 2 + 1] = 128; }
	}
}
static uint8_t ep_desc(uint8_t *p, int mps) { uint8_t e[7] = { 7, 5, 0x81, 2, LE16(mps), 0 }; memcpy(p, e, 7); return 7; }
static int conf(uint8_t *p, int mps) {
	int t = 9 + sizeof body + 7; uint8_t c[9] = { 9, 2, LE16(t), 2, 1, 0, 0xc0, 50 };
	memcpy(p, c, 9); memcpy(p + 9, body, sizeof body); ep_desc(p + 9 + sizeof body, mps); return t;
}
static void fill_probe(void) {
	int f = cur[2]; uint32_t sz = f == 3 ? 153600 : 614400, iv = IVL, pl = 16384;
	if (f < 1 || f > 3) { cur[2] = 1; } cur[0] = 1; cur[1] = 0; cur[3] = 1;
	memcpy(cur + 4, &iv, 4); memcpy(cur + 18, &sz, 4); memcpy(cur + 22, &pl, 4);
}
static int epfd = -1;
static void *pump(void *a) {
	uint8_t *fr = malloc(614400), pl[16384]; int fid = 0; uint32_t n = 0; struct timespec t;
	clock_gettime(CLOCK_MONOTONIC, &t);
	for (;; n++) {
		if (!streaming) { usleep(20000); clock_gettime(CLOCK_MONOTONIC, &t); n = 0; continue; }
		int f = cur[2]; size_t len; uint8_t *src = fr;
		if (f == 2) { int lit = bright > 128; src = lit ? fjpg : jpg; len = lit ? flen : jlen; }
		else if (f == 3) { uint16_t *z = (void *)fr; len = 153600; for (int y = 0; y < 240; y++) for (int x = 0; x < 320; x++) z[y * 320 + x] = 500 + x + n % 100; }
		else { len = 614400; scene(fr); }
		if (!strcmp(mode, "short")) len /= 2;
		for (size_t o = 0; o < len;) {
			size_t c = len - o; if (c > sizeof pl - 2) c = sizeof pl - 2;
			if (c + 2 < sizeof pl && (c + 2) % 512 == 0) c -= 2;
			pl[0] = 2; pl[1] = 0x80 | fid | (o + c == len ? 2 : 0); memcpy(pl + 2, src + o, c);
			ssize_t w = write(epfd, pl, c + 2);
			if (w < 0) { if (errno == EINTR) continue; printf("uvcg: ep write %s\n", strerror(errno)); if (errno == ESHUTDOWN || errno == ENODEV) return 0; usleep(50000); break; }
			o += c; if (!streaming) break;
		}
		fid ^= 1; t.tv_nsec += 1000000000 / fps; if (t.tv_nsec >= 1000000000) { t.tv_nsec -= 1000000000; t.tv_sec++; }
		clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, 0);
	}
}
static void stall(int in) { char c; if (in) (void)!read(ep0, &c, 0); else (void)!write(ep0, &c, 0); }
static void setup(struct usb_ctrlrequest *s) {
	int in = s->bRequestType & 0x80, cs = s->wValue >> 8, unit = s->wIndex >> 8, intf = s->wIndex & 255, len = s->wLength; uint8_t b[64] = { 0 }; int n = -1;
	if (s->bRequestType == 0 && s->bRequest == 9) {
		if (epfd < 0) { char path[64]; snprintf(path, sizeof path, "/dev/gadget/ep1in-bulk"); epfd = open(path, O_RDWR); uint8_t c[18] = { 1, 0, 0, 0 }; ep_desc(c + 4, 64); ep_desc(c + 11, 512);
			if (epfd < 0 || write(epfd, c, 18) != 18) { printf("uvcg: ep setup %s\n", strerror(errno)); }
			pthread_t t; pthread_create(&t, 0, pump, 0); }
		(void)!read(ep0, b, 0); return;
	}
	if ((s->bRequestType & 0x7f) == 0x02 || s->bRequest == 11) { (void)!read(ep0, b, 0); return; }
	if (s->bRequest == 6 && cs == 3) { const char *str = (s->wValue & 255) == 1 ? "h2" : "h2 virtual UVC"; if (!(s->wValue & 255)) { b[0] = 4; b[1] = 3; b[2] = 9; b[3] = 4; n = 4; } else { n = 2; for (; *str; str++) { b[n++] = *str; b[n++] = 0; } b[0] = n; b[1] = 3; } }
	else if ((s->bRequestType & 0x60) == 0x20 && intf == 1) {
		if (in) { memcpy(b, cur, 26); n = 26; if (s->bRequest == 0x85) { b[0] = 26; b[1] = 0; n = 2; } if (s->bRequest == 0x86) { b[0] = 3; n = 1; } }
		else { n = read(ep0, b, len); if (n > 0) { memcpy(cur, b, n > 26 ? 26 : n); fill_probe(); if (cs == 2) { streaming = 1;  } } return; }
	} else if ((s->bRequestType & 0x60) == 0x20 && intf == 0 && unit == 1 && (cs == 2 || cs == 4)) {
		int size = cs == 2 ? 1 : 4;
		if (in) {
			uint32_t v = cs == 2 ? (uint32_t)ae : exposure;
			switch (s->bRequest) {
				case 0x82: v = 1; break; case 0x83: v = cs == 2 ? 9 : 600; break; case 0x84: v = cs == 2 ? 9 : 1; break;
				case 0x87: v = cs == 2 ? 8 : 100; break; case 0x86: v = 3; break; case 0x85: v = size; break; }
			memcpy(b, &v, 4); n = s->bRequest == 0x86 ? 1 : s->bRequest == 0x85 ? 2 : size;
		} else { n = read(ep0, b, len); if (n > 0) { if (cs == 2) ae = b[0]; else memcpy(&exposure, b, 4); } return; }
	} else if ((s->bRequestType & 0x60) == 0x20 && intf == 0 && unit == 2 && cs == 2) {
		if (in) { int v = bright; switch (s->bRequest) { case 0x82: v = 0; break; case 0x83: v = 255; break; case 0x84: v = 1; break; case 0x87: v = 128; break; case 0x86: v = 3; break; case 0x85: v = 2; break; } b[0] = v; n = s->bRequest == 0x86 ? 1 : 2; }
		else { n = read(ep0, b, len); if (n > 0) { bright = b[0];  } return; }
	}
	if (n < 0) { stall(in); return; }
	if (n > len) n = len;
	if (in) { if (write(ep0, b, n) < 0) printf("uvcg: ep0 write %s\n", strerror(errno)); }
}
int main(int c, char **v) {
	const char *files[2] = { "/dev/null", "/dev/null" };
	for (int o; (o = getopt(c, v, "r:j:f:m:e:i:")) != -1;) switch (o) {
		case 'r': fps = atoi(optarg); break; case 'j': files[0] = optarg; break; case 'f': files[1] = optarg; break;
		case 'm': mode = optarg; break;
		case 'i': { unsigned a, b; if (sscanf(optarg, "%x:%x", &a, &b) != 2) return 2; dev_desc[8] = a; dev_desc[9] = a >> 8; dev_desc[10] = b; dev_desc[11] = b >> 8; break; } case 'e': exposure = atoi(optarg); break; default: return 2; }
	setvbuf(stdout, 0, _IOLBF, 0); signal(SIGPIPE, SIG_IGN);
	uint8_t **to[2] = { &jpg, &fjpg }; size_t *lens[2] = { &jlen, &flen };
	for (int i = 0; i < 2; i++) { int j = open(files[i], O_RDONLY); *to[i] = calloc(1, 1 << 20); ssize_t got = j >= 0 ? read(j, *to[i], 1 << 20) : 0; *lens[i] = got > 4 ? got : 64; close(j); }
	if (!strcmp(mode, "garbage")) memset(jpg, 0x5a, jlen), memset(fjpg, 0x5a, flen);
	if (!strcmp(mode, "huge")) for (size_t i = 0; i + 9 < sizeof body; i++) if (body[i] == 30 && body[i + 1] == 0x24 && body[i + 2] == 5) memset(body + i + 5, 0xff, 4);
	mkdir("/dev/gadget", 0755); mount("g", "/dev/gadget", "gadgetfs", 0, 0);
	ep0 = open("/dev/gadget/dummy_udc", O_RDWR); if (ep0 < 0) { perror("ep0"); return 1; }
	uint8_t d[1024] = { 0 }; int n = 4; n += conf(d + n, 64); n += conf(d + n, 512); memcpy(d + n, dev_desc, 18); n += 18;
	 cur[2] = 1; fill_probe();
	if (write(ep0, d, n) != n) { perror("dev_config"); return 1; }
	for (;;) {
		struct pollfd p = { ep0, POLLIN, 0 }; if (poll(&p, 1, 200) < 0 && errno != EINTR) return 1;
		if (!(p.revents & POLLIN)) continue;
		struct usb_gadgetfs_event e[5]; ssize_t r = read(ep0, e, sizeof e); if (r < 0) { if (errno == EIDRM || errno == EAGAIN || errno == EINTR) continue; perror("ep0 read"); return 1; }
		for (int i = 0; i < r / (int)sizeof e[0]; i++) switch (e[i].type) {
			case GADGETFS_SETUP: setup(&e[i].u.setup); break;
			case GADGETFS_DISCONNECT: streaming = 0; break;
			default: break;
		}
	}
}
