# One virtual camera and a USB camera as webcams, and USB devices of DepthAI's vendor.
load vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0 num_outputs=0 multiplanar=1
load uvcvideo nodrop=1
load dummy_hcd
load gadgetfs
mkdir -p /dev/gadget
featured --ignored --test-threads=1 --nocapture nokhwa:: oak::
