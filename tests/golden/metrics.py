"""Independent reference for the error measures of src/eval: numpy and scikit-image only.

    python3 metrics.py            prints the numbers that the unit tests of src/eval hold

The two pictures come from integer arithmetic, so that Rust makes the same ones without a file.
"""
import numpy as np
from skimage.metrics import structural_similarity

W, H = 64, 48

def pictures():
    y, x = np.mgrid[:H, :W]
    a = np.stack([((x * 7 + y * 13 + c * 29 + (x * y) % 11) % 64) / 63.0 for c in range(3)], -1)
    b = np.clip(a + (((x * 5 + y * 3) % 17)[..., None] - 8) / 60.0, 0.0, 1.0)
    return a, b

def srgb(v):
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)

def gaussian():
    t = np.arange(-5, 6)
    g = np.exp(-t * t / (2 * 1.5 ** 2))
    g /= g.sum()
    return np.outer(g, g)

def masked_ssim(a, b, mask):
    """Windows normalised over the mask, straight from the definition."""
    g, values = gaussian(), []
    for c in range(3):
        for y in range(5, H - 5):
            for x in range(5, W - 5):
                if not mask[y, x]:
                    continue
                w = g * mask[y - 5:y + 6, x - 5:x + 6]
                w = w / w.sum()
                p, q = a[y - 5:y + 6, x - 5:x + 6, c], b[y - 5:y + 6, x - 5:x + 6, c]
                mp, mq = (w * p).sum(), (w * q).sum()
                vp, vq = (w * (p - mp) ** 2).sum(), (w * (q - mq) ** 2).sum()
                cov = (w * (p - mp) * (q - mq)).sum()
                values.append((2 * mp * mq + 1e-4) * (2 * cov + 9e-4) / ((mp ** 2 + mq ** 2 + 1e-4) * (vp + vq + 9e-4)))
    return np.mean(values)

def main():
    a, b = pictures()
    linear, encoded = ((a - b) ** 2).mean(), ((srgb(a) - srgb(b)) ** 2).mean()
    s = (a * b).sum() / (b * b).sum()
    print("linear mse, psnr   %.9f %.6f" % (linear, 10 * np.log10(1 / linear)))
    print("srgb mse, psnr     %.9f %.6f" % (encoded, 10 * np.log10(1 / encoded)))
    print("scale, si-mse of b against a  %.9f %.9f" % (s, ((s * b - a) ** 2).mean()))
    print("ssim (scikit-image) %.6f" % structural_similarity(srgb(a), srgb(b), data_range=1.0, channel_axis=-1,
          gaussian_weights=True, sigma=1.5, use_sample_covariance=False))
    y, x = np.mgrid[:H, :W]
    mask = (x - 30) ** 2 + (y - 22) ** 2 < 300
    print("ssim in disc        %.6f  pixels %d" % (masked_ssim(srgb(a), srgb(b), mask), mask.sum()))
    print("ssim full, own      %.6f" % masked_ssim(srgb(a), srgb(b), np.ones((H, W), bool)))
    print("linear mse in disc  %.9f" % ((a - b)[mask] ** 2).mean())
    # Normals tilted by 0 to 30 degrees about a fixed axis.
    t = np.radians((x * 3 + y) % 31)
    n = np.stack([np.sin(t), 0 * t, -np.cos(t)], -1)
    m = np.broadcast_to(np.array([0.0, 0.0, -1.0]), n.shape)
    print("normal mse %.9f mean %.6f median %.6f" % (((n - m) ** 2).mean(), np.degrees(t).mean(), np.median(np.degrees(t))))
    # Shadows.
    found, truth = ((x + y) % 10) / 9.0, ((x + 2 * y) % 7 > 2).astype(float)
    f, q = found < 0.5, truth < 0.5
    print("shadow mse %.9f iou %.9f ber %.9f" % (((found - truth) ** 2).mean(), (f & q).sum() / (f | q).sum(),
          0.5 * ((~f & q).sum() / q.sum() + (f & ~q).sum() / (~q).sum())))
    print("percentiles of (i*37 %% 101), i<40: %.6f %.6f" % tuple(np.percentile([i * 37 % 101 for i in range(40)], [50, 95])))

if __name__ == "__main__":
    main()
