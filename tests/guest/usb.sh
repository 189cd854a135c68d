# One virtual camera, and a USB camera that the tests plug in and pull out.
load vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0 num_outputs=0 multiplanar=1
# Half pictures come through, flagged, instead of being dropped by the kernel.
load uvcvideo nodrop=1
load dummy_hcd
load gadgetfs
mkdir -p /dev/gadget
kernel --ignored --test-threads=1 --nocapture usb::
