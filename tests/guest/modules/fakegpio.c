// SPDX-License-Identifier: GPL-2.0
// Test-only GPIO chip: eight output lines whose levels, and how often line 0 rose, can be read in
// /sys/module/fakegpio/parameters. A line that is let go becomes low, as by a pull-down.
#include <linux/gpio/driver.h>
#include <linux/module.h>
#include <linux/platform_device.h>

static uint levels, rises;
static int fail_set;
module_param(levels, uint, 0444);
module_param(rises, uint, 0444);
module_param(fail_set, int, 0644);
MODULE_PARM_DESC(fail_set, "negative errno with which taking a line as output fails");
static struct platform_device *pdev;

static void fg_set(struct gpio_chip *chip, unsigned int line, int value)
{
	if (line == 0 && value && !(levels & 1))
		rises++;
	levels = value ? levels | BIT(line) : levels & ~BIT(line);
}
static int fg_get(struct gpio_chip *chip, unsigned int line) { return !!(levels & BIT(line)); }
static int fg_way(struct gpio_chip *chip, unsigned int line) { return GPIO_LINE_DIRECTION_OUT; }
static int fg_output(struct gpio_chip *chip, unsigned int line, int value)
{
	if (fail_set)
		return fail_set;
	fg_set(chip, line, value);
	return 0;
}
static void fg_free(struct gpio_chip *chip, unsigned int line) { levels &= ~BIT(line); }

static int fg_probe(struct platform_device *device)
{
	struct gpio_chip *chip = devm_kzalloc(&device->dev, sizeof(*chip), GFP_KERNEL);

	if (!chip)
		return -ENOMEM;
	chip->label = "fakegpio";
	chip->parent = &device->dev;
	chip->owner = THIS_MODULE;
	chip->base = -1;
	chip->ngpio = 8;
	chip->set = fg_set;
	chip->get = fg_get;
	chip->get_direction = fg_way;
	chip->direction_output = fg_output;
	chip->free = fg_free;
	return devm_gpiochip_add_data(&device->dev, chip, NULL);
}
static struct platform_driver driver = { .probe = fg_probe, .driver = { .name = "fakegpio" } };
static int __init fg_init(void)
{
	int result = platform_driver_register(&driver);

	if (result)
		return result;
	pdev = platform_device_register_simple("fakegpio", -1, NULL, 0);
	if (IS_ERR(pdev))
		platform_driver_unregister(&driver);
	return PTR_ERR_OR_ZERO(pdev);
}
static void __exit fg_exit(void)
{
	platform_device_unregister(pdev);
	platform_driver_unregister(&driver);
}
module_init(fg_init);
module_exit(fg_exit);
MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("virtual GPIO lines for tests");
