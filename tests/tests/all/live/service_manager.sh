# Runs a systemd of its own, in its own namespaces and its own part of the control groups (version 2). What it sees of this
# machine's files it may write over: that is lost at the end.
#   GROUP    its control group
#   FILES    folder with what goes to /etc/foreshore and, in `units`, to /etc/systemd/system
#   PROGRAM  what is installed as /usr/bin/robot-edge
set -e
if [ "$1" != inside ]; then
    mkdir "$GROUP"
    echo $$ > "$GROUP/cgroup.procs"
    exec unshare --fork --pid --kill-child --mount --mount-proc --cgroup --uts --ipc sh "$0" inside
fi

mount --make-rprivate /
mount -t tmpfs tmpfs /run
for folder in etc usr/bin var/lib; do
    mkdir -p "/run/upper/$folder" "/run/work/$folder"
    mount -t overlay overlay -o "lowerdir=/$folder,upperdir=/run/upper/$folder,workdir=/run/work/$folder" "/$folder"
done
# Other hierarchies, of version 1, are this machine's.
umount --recursive /sys/fs/cgroup
mount -t cgroup2 cgroup2 /sys/fs/cgroup

# As docs/deployment.md installs it.
useradd --system --home-dir /var/lib/foreshore foreshore
install -d -o root -g foreshore -m 750 /etc/foreshore
touch /usr/bin/robot-edge
mount --bind "$PROGRAM" /usr/bin/robot-edge
cp "$FILES"/*.* /etc/foreshore/
cp -r "$FILES"/units/* /etc/systemd/system/
mount -t tmpfs tmpfs /tmp
export container=foreshore-test
exec /lib/systemd/systemd --system --unit=foreshore-test.target --log-target=null
